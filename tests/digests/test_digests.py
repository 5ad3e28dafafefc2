# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The bits of what ships stay: a digest of each topic, attachment, column, array and claim.

A line of `digests.txt` is `scenario controller name digest`; nodes, campaigns, proofs and trainings
say so in the first word. `KEEP=1 pytest tests/digests -m '' -k list` writes it anew, in parts as
one likes (`-k docking_leo`, `-k campaign`). A line changes only in a commit of its own that says
why; what is dropped takes its own lines away, and changes no other.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import adapter
import pytest

LIST = Path(__file__).with_name('digests.txt')
DIGITS = 16
"""Of a SHA-256."""
RUNS = 80
"""Of a campaign."""

CONTROLLERS = (
    'allround', 'paper_ga', 'handmade', 'more_words', 'time_to_go',
    'mpc', 'lqr', 'pd', 'apf_smc', 'drift',
)  # fmt: skip
SCENARIOS = (
    'approach', 'assured', 'paper_box', 'paper_corner', 'paper_test', 'paper_test_measured',
    'paper_test_phase', 'quick', 'world_elliptic', 'world_leo', 'world_moon',
    'apollo', 'around', 'docking', 'docking_leo', 'guarded', 'hold_points', 'least_energy',
    'on_command', 'passive_approach', 'tumbling_docking', 'tumbling_port',
    'paper_training[0]', 'paper_training[215]', 'least_energy_starts[0]',
    'least_energy_starts[215]',
)  # fmt: skip
REFUSED = (('apollo', 'mpc'), ('apollo', 'time_to_go'))
"""These controllers count ticks of 0.1 s; the scenario has ticks of 1 s."""
TURNING = ('apollo', 'tumbling_docking')
NODES = ('approach', 'paper_test', 'docking_leo', 'tumbling_docking')
CAMPAIGNS = (
    'corner_starts', 'docking', 'docking_leo', 'least_energy', 'paper_test', 'paper_test_measured',
    'random_moving_starts', 'random_starts', 'tumbling_docking', 'tumbling_port', 'world_leo',
    'world_leo_ideal', 'world_leo_stuck',
)  # fmt: skip
RACE = ('race.rounds=1', 'race.entrants=2', 'race.evaluations=70', 'cmaes.evaluations=120')
DRAWN = tuple(f'fitness.drawn.{key}={n}' for key, n in (('pool', 20), ('held_out', 20)))
FAMILY = (
    'cmaes.population=6', 'cmaes.evaluations=12', 'staged.stages=2', 'staged.evaluations=6',
    'fitness.drawn.campaigns=[paper_test]', 'fitness.drawn.flights=10',
)  # fmt: skip
TRAININGS = {
    'paper': ('--preset paper', ('ga.generations=4',)),
    'best': ('--preset best', RACE),
    'allround': ('--preset allround', (*RACE, *DRAWN, 'fitness.drawn.flights=4', 'race.last=70')),
    'robust': ('--preset robust', RACE),
    'front': ('--preset front', ('ga.generations=3', 'ga.population=20')),
    'family': ('--family time_to_go', (*FAMILY, *DRAWN)),
    'attitude': ('--attitude --preset best', RACE),
}

FLOWN = [(scenario, controller) for scenario in SCENARIOS for controller in CONTROLLERS]
FLOWN = [pair for pair in FLOWN if pair not in REFUSED]
FLOWN += [(name, f'allround+attitude_{law}') for name in TURNING for law in ('lqr', 'pd')]
SOME = [pair for pair in FLOWN if pair[1] == 'allround' or pair[0] == 'paper_test']
"""Every stage, and every controller, once: interpreted too, with the same lines."""
FLIGHTS = [('compiled', *pair) for pair in FLOWN] + [('interpreted', *pair) for pair in SOME]
PARTS = [
    *(f'{scenario} {controller}' for scenario, controller in FLOWN),
    *(f'nodes:{name} allround' for name in NODES),
    *(f'campaign:{name}' for name in CAMPAIGNS),
    *(f'proof:{kind} allround' for kind in ('together', 'apart')),
    *(f'training:{name}' for name in TRAININGS),
]
"""How the lines of each test begin."""


def marked(values: Iterable[Any], quick: Iterable[Any] = (), landing: Iterable[Any] = ()) -> Any:
    """Return parameters; but for the quick ones and those of each landing they are slow."""
    several = {value: value if isinstance(value, tuple) else (value,) for value in values}
    marks = dict.fromkeys(several, (pytest.mark.slow,))
    marks |= dict.fromkeys(landing, (pytest.mark.every_landing,)) | dict.fromkeys(quick, ())
    return [pytest.param(*of, marks=marks[it], id='-'.join(of)) for it, of in several.items()]


def assert_listed(part: str, found: adapter.Named) -> None:
    """Assert that the list has these digests of a part and no others; with `KEEP`, write them."""
    lines = {f'{part} {name} {hashlib.sha256(data).hexdigest()[:DIGITS]}' for name, data in found}
    with LIST.open('r+') as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # of several workers
        listed = set(file.read().splitlines())
        theirs = {line for line in listed if line.startswith(f'{part} ')}
        if 'KEEP' in os.environ:
            file.seek(0)
            file.writelines(f'{line}\n' for line in sorted(listed - theirs | lines))
            file.truncate()
            theirs = lines
    names = sorted({line.rpartition(' ')[0] for line in lines ^ theirs})
    assert not names, f'{len(names)} of {len(lines | theirs)} digests differ: {names}'


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ('arithmetic', 'scenario', 'controller'),
    marked(
        FLIGHTS,
        [('compiled', 'quick', name) for name in CONTROLLERS],
        [('compiled', *pair) for pair in SOME] + [('interpreted', 'paper_test', 'allround')],
    ),
)
def test_flights_have_the_digests_of_the_list(arithmetic, scenario, controller, tmp_path):
    interpreted = arithmetic == 'interpreted'
    found = adapter.flight(tmp_path / 'run', scenario, controller, interpreted=interpreted)
    assert_listed(f'{scenario} {controller}', found)


@pytest.mark.timeout(900)
@pytest.mark.parametrize('scenario', marked(NODES, landing=NODES[:2]))
def test_flights_of_nodes_have_the_digests_of_the_list(scenario, ros_env, tmp_path):
    found = adapter.flight_of_nodes(tmp_path / 'run', scenario, 'allround', ros_env)
    assert_listed(f'nodes:{scenario} allround', found)


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ('arithmetic', 'name'),
    marked(
        [*(('compiled', name) for name in CAMPAIGNS), ('interpreted', 'random_starts')],
        landing=[('compiled', 'paper_test'), ('compiled', 'docking')],
    ),
)
def test_campaigns_have_the_digests_of_the_list(arithmetic, name, tmp_path):
    interpreted = arithmetic == 'interpreted'
    found = adapter.campaign(tmp_path / 'runs', name, RUNS, interpreted=interpreted)
    assert_listed(f'campaign:{name}', found)


@pytest.mark.every_landing
@pytest.mark.timeout(900)
@pytest.mark.parametrize('kind', ['together', 'apart'])
def test_proofs_have_the_digests_of_the_list(kind, tmp_path):
    assert_listed(f'proof:{kind} allround', adapter.proof(tmp_path / 'proof', kind))


@pytest.mark.timeout(900)
@pytest.mark.parametrize('name', marked(TRAININGS, landing=['paper']))
def test_trainings_have_the_digests_of_the_list(name, tmp_path):
    assert_listed(f'training:{name}', adapter.training(tmp_path / name, *TRAININGS[name]))


def test_each_line_of_the_list_is_of_a_part_and_each_part_has_lines():
    """With `KEEP`, lines of what is gone are left out."""
    with LIST.open('r+') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        listed = file.read().splitlines()
        heads = tuple(f'{part} ' for part in PARTS)
        if 'KEEP' in os.environ:
            listed = [line for line in listed if line.startswith(heads)]
            file.seek(0)
            file.writelines(f'{line}\n' for line in listed)
            file.truncate()
    assert listed == sorted({line for line in listed if line.startswith(heads)})
    assert not [head for head in heads if not any(line.startswith(head) for line in listed)]
