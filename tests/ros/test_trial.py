# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`ros2 run rpo_bringup trial`: its tables, and what they must say at the least."""

import pytest

from tools import trial
from tools.trials import soak

SLOW = pytest.mark.slow


def rows(output):
    """Return the rows of the table in an output, without its head."""
    found = [line for line in output.splitlines() if line.startswith('| ')]
    return [[cell.strip() for cell in line.split('|')[1:-1]] for line in found[1:]]


@pytest.mark.parametrize(
    'arguments',
    [
        ['latency', '--rates', '-1'],
        ['losses', '--rates', '1.5'],
        ['losses', '--kinds', 'gossip'],
        [],
    ],
)
def test_bad_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        trial._arguments(arguments)
    assert end.value.code == 2
    assert 'error: ' in capsys.readouterr().err


def sample(tick, mb=200.0, files=18, latency_ms=0.5):
    return tick, latency_ms, [(mb, files)] * 4


GROWN = {
    'memory': ({'mb': lambda k: 200.0 + k}, 'plant has grown'),
    'files': ({'files': lambda k: 18 + k // 5}, 'recorder has grown'),
    'latency': ({'latency_ms': lambda k: 0.5 + 0.1 * k}, 'the loop has become slower'),
}


@pytest.mark.parametrize('case', GROWN)
def test_what_grows_is_named(case):
    changes, said = GROWN[case]
    samples = [
        sample(1000 * k, **{key: of(k) for key, of in changes.items()}) for k in range(1, 11)
    ]
    assert said in soak._judge(samples, 10_000)


def test_what_stays_is_no_growth_and_too_short_is_no_verdict():
    samples = [sample(1000 * k) for k in range(1, 11)]
    assert soak._judge(samples, 10_000) == []
    assert 'too short' in soak._judge(samples[:3], 10_000)[0]


@SLOW
def test_with_a_fifth_of_the_messages_spoilt_free_running_still_docks(ros):
    node = ros.node('rpo_bringup', 'trial', 'losses', '--rates', '0.2', '--factor', '20')
    assert node.wait(200.0) == 0, node.output
    (row,) = rows(node.output)
    assert row[0] == '20%'
    assert row[-1] == 'yes', node.output


@SLOW
def test_latency_is_printed_for_each_rate(ros):
    node = ros.node('rpo_bringup', 'trial', 'latency', '--rates', '10', '50', '--seconds', '3')
    assert node.wait(100.0) == 0, node.output
    found = rows(node.output)
    assert [row[:2] for row in found] == [['10 Hz', '30'], ['50 Hz', '150']]
    assert all(0.0 < float(row[2].split()[0]) < 100.0 for row in found)


@SLOW
def test_a_short_soak_prints_what_each_node_holds(ros):
    node = ros.node('rpo_bringup', 'trial', 'soak', '--ticks', '20000', '--every', '1')
    assert node.wait(200.0) in (0, 1), node.output  # a short one may be called growth
    assert len(rows(node.output)) > 3
    assert '20000 ticks in' in node.output
