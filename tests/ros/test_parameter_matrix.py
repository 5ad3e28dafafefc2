# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every parameter of every node, from the tables: what is wrong is refused in a sentence.

At the start nothing is started for it; in flight nothing changes.
"""

import math

import pytest
from inside import inside
from node_pages import CARDS, MEANINGS, NAMES, pages
from rclpy.parameter import Parameter
from test_launch_files import executables

from rpo_core.files.gone import GONE
from rpo_core.files.validation import InputError
from rpo_ros.parameter_rows import ParameterRow as Row
from rpo_ros.running import FlightNode, declare, run

each_card = pytest.mark.parametrize('card', CARDS, ids=lambda card: card.executable)


def wrong(row: Row) -> list[object]:
    """Return values that a row must refuse."""
    if isinstance(row.default, bool):
        return [1, 0.0, 'maybe', [True]]
    if isinstance(row.default, str):
        others = [1, 1.5, True, ['a', 'b']] + ([] if row.default == '' else [''])
        others += ['a b', '/x/', 'a//b', '1a', 'ä', 'a\n'] if row.ros_name else []
        return [*others, 'no such choice'] if row.choices else others
    texts = ['fast', True, [1.0, 2.0], [1]]
    least, most = row.least, row.most
    if isinstance(row.default, int):
        return [*texts, int(least) - 1, int(most) + 1, 1.5, math.nan, math.inf]
    tiny = [1e-300, row.smallest / 2.0] if row.smallest else []
    return [*texts, *tiny, least - 1.0, most * 2.0 + 1.0, math.nan, math.inf, -math.inf]


def right(row: Row) -> object:
    """Return a value, other than the default, that a row takes."""
    if isinstance(row.default, bool):
        return not row.default
    if isinstance(row.default, int):
        return int(row.most)
    if isinstance(row.default, float):
        return float(row.most)
    return row.choices[-1] if row.choices else row.default


@pytest.mark.every_landing
@each_card
def test_at_the_start_each_wrong_value_is_refused_by_name(ros_env, card):
    node_class = getattr(card.module, card.cls)
    with inside():
        for row in card.parameters:
            for value in wrong(row):
                try:
                    node_class({row.name: value})
                except InputError as error:
                    said = str(error)
                    assert f'`{row.name}' in said and '\n' not in said, said
                    continue
                raise AssertionError(f'{row.name}: {value!r} is taken')


@each_card
def test_a_whole_number_is_taken_for_a_real_one(inner, card):
    for row in card.parameters:
        if type(row.default) is float:
            node = inner.start(FlightNode('bare', {row.name: math.ceil(row.least)}))
            value = declare(node, [row])[row.name]
            assert isinstance(value, float) and value == math.ceil(row.least)


def test_a_factor_of_time_has_a_smallest_value_and_a_timer_a_longest_period(inner):
    for card, name in (('plant', 'real_time_factor'), ('replay', 'rate')):
        (row,) = (r for c in CARDS if c.executable == card for r in c.parameters if r.name == name)
        assert row.check(0) == 0.0 and row.check(row.smallest) == row.smallest
        with pytest.raises(InputError, match=f'`{name}` must be 0, or 1e-06 to 1e.06; got 1e-12'):
            row.check(1e-12)
    inner.start(FlightNode('bare')).every(1e300, lambda: None)


@each_card
def test_an_unknown_name_is_warned_of_with_the_nearest(inner, card, capfd):
    row = max(card.parameters, key=lambda row: len(row.name))
    node = inner.start(FlightNode('bare', {f'{row.name}x': 1.0, 'use_sim_time': False}))
    declare(node, card.parameters)
    said = capfd.readouterr().err
    assert f'this node has no parameter `{row.name}x`; did you mean `{row.name}`' in said
    assert 'use_sim_time' not in said


@each_card
def test_in_flight_nothing_wrong_is_taken_and_foreign_ones_are_not_refused(inner, card):
    """The table alone: a node adds its own refusals, see test_lifecycle."""
    rows = card.parameters
    node = inner.start(FlightNode('bare'))
    values = declare(node, rows)
    before = dict(values)
    seen = []
    node.changed = seen.append
    for row in rows:
        for value in wrong(row):
            result = node.set_parameters_atomically([Parameter(row.name, value=value)])
            assert not result.successful, f'{row.name}: {value!r} is taken'
            assert row.name in result.reason and '\n' not in result.reason, result.reason
        assert values == before and not seen
        result = node.set_parameters_atomically([Parameter(row.name, value=right(row))])
        assert result.successful == row.changeable, result.reason
        if row.changeable:
            assert values[row.name] == right(row) and list(seen.pop()) == [row.name]
            before = dict(values)
        else:
            assert 'read-only' in result.reason
    sim_time = Parameter('use_sim_time', value=True)
    assert node.set_parameters_atomically([sim_time]).successful


def test_one_wrong_value_of_a_request_refuses_all_of_it(inner):
    rows = (
        Row('speed', 1.0, 'speed', most=9.0, changeable=True),
        Row('gain', 1.0, 'gain', most=9.0, changeable=True),
        Row('steps', 3, 'steps', least=1, most=9, changeable=True),
    )
    values = declare(inner.start(FlightNode('bare')), rows)
    good = {'speed': 2, 'gain': 4.0, 'steps': 4}
    for bad in ({'gain': [4.0, 5.0]}, {'gain': math.nan}, {'steps': 10}):
        successful, reason = inner.set('/bare', **{**good, **bad})
        assert not successful and next(iter(bad)) in reason
        assert values == {'speed': 1.0, 'gain': 1.0, 'steps': 3}
    assert inner.set('/bare', **good) == (True, '')
    assert values == {'speed': 2.0, 'gain': 4.0, 'steps': 4}
    assert isinstance(values['speed'], float)
    successful, reason = inner.set('/bare', nothing_of_ours=1)
    assert not successful and 'undeclared' in reason


def test_a_name_that_ros_does_not_take_is_one_sentence(ros_env, capfd):
    """A name of a table is refused by its row; this is the last resort."""
    assert run(lambda: [FlightNode('a b')]) == 2
    said = capfd.readouterr().err.strip()
    assert 'Invalid node name: node name must not contain' in said and said.endswith(": 'a b'")
    assert '\n' not in said


# The pages of the nodes, from the same tables.

COMMANDS = {'final_approach', 'flight_software', 'ping_pong'}
COMMANDS |= {'verify', 'info', *GONE['executable']}
"""Executables that are no nodes."""


def test_every_node_has_its_page_and_every_meaning_a_node(ros_env):
    found = pages()
    assert set(found) == set(NAMES)
    said = ''.join(found.values())
    assert '| publishes | `/tf` | `tf2_msgs/TFMessage` |' in found['visualizer.md']
    unused = [name for name in MEANINGS if f'`{name}`' not in said]
    assert not unused, 'no node has them any more'


def test_every_executable_has_a_card():
    scripts = {name for _, name in executables()}
    cards = {card.executable for card in CARDS}
    assert cards <= scripts and scripts - cards <= COMMANDS
