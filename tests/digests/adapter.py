# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the digests are of: flights, campaigns, proofs and trainings, made by our commands.

Only this module and `proofs` name our commands and packages: where they move, only these change.
"""

from __future__ import annotations

import csv
import hashlib
import os
import re
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from invoking import invoke
from mcap.reader import make_reader
from proofs import problem_of_kind, proof_of

from rpo_core.scenario.scenario import dumps, load_set

Named = Iterator[tuple[str, bytes]]
"""What a digest is of: its name in the list, its bytes."""

PROVENANCE = re.compile(r'^provenance:.*?(?=^\S|\Z)', re.M | re.S)
"""Who made a file, by which command, when: not what it does."""


def rpo(*words: object, interpreted: bool = False, process: bool = False) -> None:
    """Run the command `rpo`; an own process where it asks for one."""
    if not interpreted and not process:
        done = invoke(*words)
        assert done.exit_code in (0, 1), done.output
        return
    run({'RPO_JIT': '0'} if interpreted else {}, 'rpo', *words)


def run(environment: Mapping[str, str], *words: object) -> None:
    """Run a command; it may find that a requirement is missed."""
    done = subprocess.run(
        list(map(str, words)),
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr


def options(name: str, values: Iterable[str]) -> list[str]:
    return [word for value in values for word in (name, value)]


def flight(folder: Path, scenario: str, controller: str, **how: bool) -> Named:
    """Fly one flight through the chain.

    scenario : `set[7]` is the flight of a set from its start 7
    controller : `name+other` has another controller of attitude
    """
    controller, _, attitude = controller.partition('+')
    changes = [f'attitude_control.controller={attitude}'] if attitude else []
    name, _, number = scenario.rstrip(']').partition('[')
    if number:
        start = replace(load_set(name).scenarios()[int(number)], name=f'{name}_{number}')
        name = f'{folder}.yaml'
        Path(name).write_text(dumps(start))
    words = '--controller', controller, *options('--set', changes)
    rpo('simulate', name, *words, '--no-fail', '--output', folder, **how)
    yield from logged(folder / 'run.mcap', ('parameters.yaml',))  # of a command: its words


def flight_of_nodes(
    folder: Path, scenario: str, controller: str, environment: Mapping[str, str]
) -> Named:
    """Fly with nodes in one process, which wait for each other however long they take."""
    flown = '--scenario', scenario, '--controller', controller, '--output', folder, '--no-report'
    patient = options('-p', ['plant:start_timeout_s:=0.0', 'plant:peer_timeout_s:=600.0'])
    run(environment, 'ros2', 'run', 'rpo_bringup', 'final_approach', *flown, '--ros-args', *patient)
    for name, content in logged(folder / 'run.mcap'):
        if name != 'parameters.yaml':
            yield name, content
            continue
        for node, values in yaml.safe_load(content).items():
            for key, value in values.items():
                yield f'{name}:{node}.{key}', repr(value).encode()


def logged(path: Path, omitted: Iterable[str] = ()) -> Named:
    """Yield each topic of a log with its payloads, and each attachment without its provenance."""
    with path.open('rb') as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        found = {channel.topic: hashlib.sha256() for channel in summary.channels.values()}
        for _, channel, message in reader.iter_messages(log_time_order=False):
            size = len(message.data).to_bytes(8, 'little')
            found[channel.topic].update(size + message.data)
        yield from ((topic, digest.digest()) for topic, digest in found.items())
        for attached in reader.iter_attachments():
            if attached.name not in omitted:
                yield attached.name, PROVENANCE.sub('', attached.data.decode()).encode()


def campaign(folder: Path, name: str, runs: int, **how: bool) -> Named:
    """Fly a campaign; the names begin with its controller."""
    rpo('campaign', name, '--runs', runs, '--workers', 1, '--output', folder, '--no-fail', **how)
    controller = yaml.safe_load((folder / 'controller.yaml').read_text())['name']
    yield from ((f'{controller} {key}', array) for key, array in arrays(folder / 'results.npz'))
    counts = yaml.safe_load((folder / 'summary.yaml').read_text())['rates']['success']['count']
    yield f'{controller} successes', str(counts).encode()


def arrays(path: Path) -> Named:
    """Yield the arrays of a file, with their form."""
    with np.load(path) as saved:
        for key in saved.files:
            form = f'{saved[key].dtype} {saved[key].shape} '
            yield key, form.encode() + np.ascontiguousarray(saved[key]).tobytes()


def proof(folder: Path, kind: str) -> Named:
    """Prove little: axes together, for ever, one claim refuted; or each axis apart."""
    made = proof_of(problem_of_kind(kind, 'allround'), folder)
    for path in sorted(folder.glob('*.npz')):
        yield from ((f'{path.stem}.{key}', content) for key, content in arrays(path))
    yield from ((f'claim:{key}', value) for key, value in leaves(made.summary()))


def leaves(value: Any, name: str = '') -> Named:
    """Yield each value of a document, by its keys."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f'{name}.{key}'.strip('.').replace(' ', '_'))
    else:
        yield name, repr(value).encode()


def training(folder: Path, command: str, settings: Iterable[str]) -> Named:
    """Train in a process of its own, whose arithmetic is pinned."""
    words = *command.split(), *options('--set', settings)
    rpo('train', *words, '--workers', 1, '--no-plots', '--output', folder, process=True)
    trained = (folder / f'{folder.name}.yaml').read_text()
    yield 'controller.yaml', PROVENANCE.sub('', trained).encode()
    with (folder / 'history.csv').open() as file:
        header, *rows = csv.reader(file)
    for column, values in zip(header, zip(*rows, strict=True), strict=True):
        yield f'history.{column}', ' '.join(values).encode()
