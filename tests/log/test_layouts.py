# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Our own log, rewritten by the `mcap` library in any layout of its specification, is verified."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_parts import Parts, views
from log_runs import record
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.writer import CompressionType, IndexType

from rpo_log.errors import ExitCode
from rpo_log.read.run_log import read_run
from rpo_log.tools.diff import inspect
from rpo_log.verify import verify


@dataclass(frozen=True)
class Layout:
    """How a log is written.

    options : of the library's writer
    places : of the metadata records and attachments, as a share of the messages before them
    late : whether a channel comes just before its first message
    numbers : order of the schemas and channels
    metadata : which metadata records are kept
    library : in the header; empty for that of our recorder
    ends : shares of the messages after which a chunk ends
    """

    options: dict[str, Any] = field(default_factory=dict)
    places: tuple[float, ...] = (0.0,)
    late: bool = False
    numbers: int = 0
    metadata: tuple[str, ...] = ('rosbag2', 'rpo_run')
    library: str = 'mcap-python/1'
    ends: tuple[float, ...] = ()

    def write(self, parts: Parts, path: Path) -> None:
        """Write the records of a log."""
        messages = [one for one in parts.records if isinstance(one, Message)]
        channels = {one.id: one for one in parts.records if isinstance(one, Channel)}
        schemas = {one.id: one for one in parts.records if isinstance(one, Schema)}
        beside = [one for one in parts.records if isinstance(one, Attachment)]
        beside += [r for r in parts.records if isinstance(r, Metadata) and r.name in self.metadata]
        header = next(one for one in parts.records if isinstance(one, Header))
        at: dict[int, list[Any]] = {}
        for number, one in enumerate(beside):
            place = self.places[number % len(self.places)]
            at.setdefault(round(place * len(messages)), []).append(one)
        order = list(channels)
        first = [] if self.late else order[self.numbers :] + order[: self.numbers]
        ends = {round(end * len(messages)) for end in self.ends}
        records: list[Any] = [Header(header.profile, self.library or header.library)]
        declared: dict[int, None] = {}
        for number, message in enumerate(messages):
            for channel in [*first, message.channel_id] if number == 0 else [message.channel_id]:
                if channel not in declared:
                    records += schemas[channels[channel].schema_id], channels[channel]
                    declared[channel] = None
            records += [*at.get(number, []), message, *[None] * (number in ends)]
        Parts(records + at.get(len(messages), [])).write(path, **self.options)


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    """Return any layout that the library can write."""
    flags = draw(st.lists(st.sampled_from([IndexType.ATTACHMENT, IndexType.CHUNK,
                                           IndexType.MESSAGE, IndexType.METADATA])))  # fmt: skip
    indexes = IndexType.NONE
    for flag in flags:
        indexes |= flag
    names = ('repeat_channels', 'repeat_schemas', 'use_chunking', 'use_statistics',
             'use_summary_offsets', 'enable_crcs', 'enable_data_crcs')  # fmt: skip
    options = {name: draw(st.booleans()) for name in names}
    options['chunk_size'] = draw(st.sampled_from([1, 300, 4096, 1 << 20, 1 << 40]))
    options['compression'] = draw(st.sampled_from(list(CompressionType)))
    options['index_types'] = draw(st.sampled_from([IndexType.ALL, indexes]))
    share = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0))
    kept = st.sampled_from([('rosbag2', 'rpo_run'), ('rpo_run',), ('rosbag2',), ()])
    return Layout(
        options, tuple(draw(st.lists(share, min_size=1, max_size=6))), draw(st.booleans()),
        draw(st.integers(0, 4)), draw(kept), draw(st.sampled_from(['mcap-python/1', '', 'x'])),
        tuple(draw(st.lists(st.floats(0.0, 1.0), max_size=3))),
    )  # fmt: skip


@cache
def seen(log: Path) -> tuple[Any, ...]:
    """Return what is known of the log that is rewritten."""
    return Parts.of(log), read_run(log), verify(log).stages, inspect(log).messages, views(log)


def judge_a_layout(true: Path, folder: Path, layout: Layout) -> list[str]:
    """Return the gaps that verify names."""
    parts, same, stages, messages, shown_before = seen(true)
    path = folder / 'run.mcap'
    layout.write(parts, path)
    found = verify(path)
    assert found.difference is None, found.sentence()
    assert found.exit_code == (ExitCode.INCOMPLETE if found.gaps else ExitCode.OK)
    assert found.ticks == 11 and found.stages == stages
    if layout.library:  # then what follows from another writer's ways is not named beside
        named = ['the header is not as the recorder writes it']
        missing = [name for name in ('rosbag2', 'rpo_run') if name not in layout.metadata]
        named += [f"the metadata '{name}' is missing" for name in missing]
        assert '; '.join(found.gaps) == '; '.join(f'run.mcap: {gap}' for gap in named)
    log = read_run(path)
    assert log.attachments == same.attachments and log.complete
    assert inspect(path).messages == messages
    for name, values in same.values.items():
        np.testing.assert_array_equal(log.values[name], values)
    shown = views(path)
    assert shown['streaming'] == shown_before['streaming']
    seeking = shown['seeking']  # without channels in the summary it ends with an error
    assert seeking == shown['streaming'] or str(seeking).startswith('KeyError: ')
    return list(found.gaps)


@pytest.mark.parametrize('count', [25, pytest.param(500, marks=pytest.mark.slow)])
def test_any_layout_is_recomputed(true, tmp_path, count):
    @settings(max_examples=count)
    @given(layout=layouts())
    def judge(layout):
        judge_a_layout(true, tmp_path, layout)

    judge()


def test_what_another_writer_leaves_out_or_adds_is_named(true, tmp_path):
    """With our header: all that differs is named, not the first thing alone."""
    options = {'enable_data_crcs': True, 'chunk_size': 1 << 40}
    everything = judge_a_layout(true, tmp_path, Layout(options, library=''))
    order = 'run.mcap: its records are not once each, in the order of the recorder'
    assert everything == [order]
    parts = Parts.of(true)
    kept = [one for one in parts.records if getattr(one, 'name', '') != 'parameters.yaml']
    topic = next(one for one in kept if isinstance(one, Channel))
    parts.records = [
        Channel(9, '/other', 'cdr', {}, topic.schema_id)
        if one is None and at == [i for i, each in enumerate(kept) if each is None][2]
        else one
        for at, one in enumerate(kept)
    ]  # fmt: skip
    parts.write(tmp_path / 'run.mcap')
    assert verify(tmp_path / 'run.mcap').gaps[0] == (
        "run.mcap: the channel '/other' is not as the recorder writes it"
    )


def test_a_renamed_log_is_a_bag_and_no_recorded_folder(tmp_path):
    folder = record(tmp_path / 'run')
    os.rename(folder / 'run.mcap', folder / 'flight.mcap')
    text = (folder / 'metadata.yaml').read_text()
    (folder / 'metadata.yaml').write_text(text.replace('run.mcap', 'flight.mcap'))
    found = verify(folder)
    assert found.exit_code == ExitCode.DIFFERENT
    assert 'run.mcap is missing, which SHA256SUMS lists' in found.sentence()
    (folder / 'SHA256SUMS').unlink()
    assert inspect(folder).ticks == (0, 30)
