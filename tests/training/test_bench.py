# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The table of benchmarks: what it reads, how it is kept; the measuring itself is slow."""

import json
import os
import re
import subprocess
import time

import numpy as np
import pytest
from invoking import invoke

from rpo_core.files.validation import InputError
from rpo_montecarlo import machine, outputs
from tools.bench import flying, ros, table

ROWS = (
    table.Row('P1', 'inference', '≥ 2 ×', '4/s', '1/s', '4 ×', True),
    table.Row('P2', 'training', '≤ 1 s', '2 s', '3 s', '1.5 ×', False),
)


def bench(load=0.1):
    return table.Bench(
        '2026-01-02 03:04:05 UTC', {**machine.facts(), 'load_per_core': load}, ROWS, {'a_s': 1.5}
    )


def test_the_page_keeps_its_text_and_has_the_last_table(tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('# Speed\n\nBefore.\n')
    outputs.put(page, 'rpo bench --write', table.markdown(bench(3.0)))
    page.write_text(page.read_text() + '\nAfter.\n')
    outputs.put(page, 'rpo bench --write', table.markdown(bench()))
    text = page.read_text()
    assert text.startswith('# Speed\n\nBefore.\n') and text.endswith('\nAfter.\n')
    assert text.count('| P1 | inference | ≥ 2 × | 4/s | 1/s | 4 × | held |') == 1
    assert '| 1.5 × | MISSED |' in text
    assert 'busy' not in text
    assert 'busy' in table.markdown(bench(3.0))


def test_every_run_is_kept(tmp_path):
    path = table.save(bench(), tmp_path / 'bench')
    assert path.name == '2026-01-02-030405.json'
    kept = json.loads(path.read_text())
    assert kept['figures'] == {'a_s': 1.5}
    assert kept['rows'][1]['holds'] is False
    assert kept['machine']['cores'] >= 1
    assert machine.machine().startswith(f'{kept["machine"]["processor"]}, Python 3.')
    assert machine.machine().endswith(f', NumPy {np.__version__}')


def test_times_of_a_flight_are_the_plants():
    said = (
        '[INFO] [100.250000000] [plant]: waiting for control_force\n'
        '[INFO] [101.000000000] [plant]: flying paper_test\n'
        '[INFO] [103.500000000] [plant]: finished at 400 s: 0.07 m\n'
    )
    loop = ros._loop(said)
    assert (loop.wall_s, loop.real_time_factor, loop.ticks_per_s) == (2.5, 160.0, 1600.0)
    with pytest.raises(InputError, match='no times of the flight'):
        ros._loop(said.splitlines()[1])


@pytest.mark.parametrize(
    ('speeds', 'wanted'),
    [
        ([1.0, 1.0, 1.0, 1.0, 0.1, 0.1, 0.1], [2.0, 2.0, 2.0 / 0.55]),
        ([1.0 - 0.05 * k for k in range(7)], [2.0, 2.0, 2.0]),
    ],
)
def test_a_flight_and_the_peer_take_turns(speeds, wanted, monkeypatch):
    """A machine that becomes ten times slower, or slower all the time: the median ratio stays."""
    said, left = [], iter(speeds)

    def peer():
        said.append('peer')
        return 1000.0 * next(left)

    def fly():
        said.append('flight')
        return ros.Loop(2.0 / next(left), 4000, 400.0)

    monkeypatch.setattr(ros, 'ping_pong', peer)
    loop, trips, ratios = ros.in_turns(fly, 3)
    assert said == [*['peer', 'flight'] * 3, 'peer']
    assert loop.ticks_per_s == 2000.0 * sorted(speeds[1::2])[1]
    assert trips == pytest.approx(1000.0 * np.median(speeds[::2]))
    assert ratios == pytest.approx(wanted)


def test_the_loop_is_judged_by_the_peer_where_machines_differ(monkeypatch):
    """One flight at 160 times real time, in turns with a peer of each speed."""
    loops = [('P4', 'loop', None, 1.2, ros.PEER), ('B7', 'loop', None, 160.0, ros.REAL_TIME)]
    for median, holds in ((1.19, [False, True]), (1.2, [True, True]), (1.3, [True, True])):
        ratios = [0.5, median, 9.0]
        monkeypatch.setattr(ros, 'LOOPS', loops)
        monkeypatch.setattr(
            ros, 'in_turns', lambda *_, r=ratios: (ros.Loop(2.5, 4000, 400.0), 1e3, r)
        )
        rows = table.run(what='ros').rows
        assert [row.holds for row in rows] == holds
        assert [row.wanted for row in rows] == ['≥ 1.2 × the peer', '≥ 160 × real time']


def test_without_ros_it_says_what_to_do(monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')
    with pytest.raises(InputError, match=r'source ros_ws/env\.bash'):
        ros.ping_pong()


def test_each_run_of_nodes_has_a_domain_of_its_own():
    with ros._nodes() as one, ros._nodes() as two:
        assert one.env['ROS_DOMAIN_ID'] != two.env['ROS_DOMAIN_ID']


def test_a_stopped_benchmark_leaves_no_node(tmp_path, monkeypatch):
    node, began = tmp_path / 'lib' / 'rpo_bringup' / 'ping_pong', tmp_path / 'began'
    node.parent.mkdir(parents=True)
    node.write_text(f'#!/bin/sh\necho $$ > {began}.new; mv {began}.new {began}\nexec sleep 200\n')
    node.chmod(0o755)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    bench = subprocess.Popen(['rpo', 'bench', 'ros'], stderr=subprocess.PIPE, text=True)
    while not began.exists():
        assert bench.poll() is None
        time.sleep(0.02)
    bench.terminate()
    assert 'Interrupted; its nodes have ended' in bench.communicate()[1]
    assert bench.returncode == 130
    with pytest.raises(ProcessLookupError):
        os.kill(int(began.read_text()), 0)


@pytest.mark.slow
def test_the_parts_that_fly_count_what_they_fly():
    shares = []
    budget = flying.training(70, 1, shares.append)
    assert shares == [60 / 70, 1.0]
    assert budget.evaluations == 70 and budget.steps == 2000
    assert budget.cpu_s > 0


@pytest.mark.slow
def test_the_ros_loop_is_measured():
    result = invoke('bench', 'ros')
    assert result.exit_code == 0, result.output
    trips = [float(x) for x in re.findall(r'(\d+) round trips/s', result.output)]
    four, one, *_ = (float(x) for x in re.findall(r'(\d+) ticks/s', result.output))
    assert min(four, one) > 0 and max(four, one) < 10 * trips[0]
