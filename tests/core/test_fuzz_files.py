# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whatever a file holds, the loaders give an object that can be used, or an InputError."""

from __future__ import annotations

import contextlib
import datetime
import math

import pytest
import yaml
from core_documents import DOCUMENTS, PARSERS, changed, keys, shipped_text
from hypothesis import given
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import FuzzyController
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-(10**320), 10**320),
    st.floats(),
    st.text(max_size=12),
    st.sampled_from(['LN', 'Z', 'none', 'paper_phase', 'odd', 'min', '1e-3', 'nan', 'x', 'rpo/']),
    st.dates(),
    st.datetimes(timezones=st.just(datetime.timezone.utc)),
    st.binary(max_size=5),
)
structures = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=6),
        st.dictionaries(st.text(max_size=8) | scalars, inner, max_size=6),
    ),
    max_leaves=12,
)
SOUP = 'aN01:-,[]{}&*!|>%@`#?"\'\\ \n\t.e+~=<\ufeff\x85\U0001f600'
yaml_soup = st.text(st.sampled_from(SOUP), max_size=120)


def all_keys(data):
    return [*keys(data), *[(*path, 0) for path in keys(data)]]


def spoilt(kind):
    """Return a strategy of shipped documents with one or two values replaced by anything."""

    def spoil(data, choices):
        for path, value in choices:
            try:
                data = changed(data, path, value)
            except (KeyError, IndexError, TypeError):  # an earlier change took the place away
                continue
        return data

    documents = [data for (found, _), data in DOCUMENTS.items() if found == kind]
    return st.sampled_from(documents).flatmap(
        lambda data: st.builds(
            spoil,
            st.just(data),
            st.lists(
                st.tuples(st.sampled_from(all_keys(data)), structures | st.floats(-2, 2)),
                min_size=1,
                max_size=2,
            ),
        )
    )


NAMES = {
    'scenario': ['paper_test', 'paper_training', 'quick'],
    'controller': ['handmade'],
}


def mangled(kind):
    """Return a strategy of shipped texts with pieces cut out, doubled or replaced."""

    def mangle(content, cuts):
        for start, length, piece in cuts:
            start = int(start * len(content))
            content = content[:start] + piece + content[start + length :]
        return content

    pieces = st.one_of(yaml_soup, st.text(max_size=3), st.sampled_from(['e', '-', '.', ': ', '\n']))
    cuts = st.tuples(st.floats(0, 1), st.integers(0, 20), pieces)
    texts = st.sampled_from([shipped_text(kind, name) for name in NAMES[kind]])
    return st.builds(mangle, texts, st.lists(cuts, min_size=1, max_size=4))


def check(kind, content):
    """Load; only an InputError of one line may escape, and what loads must be usable."""
    try:
        loaded = files.loads(content, PARSERS[kind], 'fuzz.yaml')
    except InputError as error:
        message = str(error)
        assert message.startswith('fuzz.yaml: ') and '\n' not in message and len(message) < 500
        return
    if isinstance(loaded, FuzzyController):
        force = loaded.force_n((10.0, -60.0, 0.1), (0.1, 0.0, -5.0))
        assert all(math.isfinite(f) and abs(f) <= loaded.force_scale_n for f in force)
    elif isinstance(loaded, Scenario):
        assert all(map(math.isfinite, loaded.step))
        assert all(map(math.isfinite, loaded.disturbance.over([loaded.ticks], loaded.dt_ns)[0]))
        assert 0 < loaded.stamp_ns(loaded.ticks) < 2**31 * 10**9


def check_document(kind, data):
    check(kind, yaml.safe_dump(data, allow_unicode=True, sort_keys=False))
    with contextlib.suppress(InputError):
        PARSERS[kind](data)  # and without YAML between


DRAWN = {
    'anything': lambda kind: structures,
    'soup': lambda kind: yaml_soup,
    'spoilt documents': spoilt,
    'mangled texts': mangled,
}
"""What files hold, by kind; texts, or documents."""


def check_drawn(kind, drawn):
    check(kind, drawn) if isinstance(drawn, str) else check_document(kind, drawn)


@pytest.mark.parametrize('kind', PARSERS)
@pytest.mark.parametrize('source', DRAWN)
@given(data=st.data())
def test_files(kind, source, data):
    check_drawn(kind, data.draw(DRAWN[source](kind)))


@given(data=st.data())
def test_what_loads_can_be_flown(data, handmade):
    """A scenario that loads flies, whatever its numbers, without a number that is not finite."""
    content = data.draw(mangled('scenario'))
    try:
        loaded = files.loads(content, PARSERS['scenario'], 'fuzz.yaml')
    except InputError:
        return
    if isinstance(loaded, Scenario) and loaded.ticks <= 4000:
        flight = fly(loaded, handmade)
        assert all(map(math.isfinite, flight.states.ravel()))
