# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's test in free running, with messages lost, repeated, delayed and reordered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import verdicts
from tools.trials import common

KINDS = ('drop', 'repeat', 'delay', 'reorder')


def _row(rate: float, kinds: Sequence[str], factor: float, seed: int, stale: int) -> str:
    share: dict[str, Any] = {**dict.fromkeys(kinds, rate), 'seed': seed}
    raw, faulty = 'control_force_raw', 'relative_state_faulty'
    with common.trial_nodes() as nodes:
        path = common.scenario(nodes.folder, 'paper_test')
        nodes.node('rpo_sim', 'disturbance_injector', scenario=path)
        remap = {'relative_state': faulty, 'control_force': raw}
        nodes.node('rpo_ctrl', 'fuzzy_controller', remap=remap, controller=DEFAULT_CONTROLLER)
        name = {'__node': 'faults_of_forces'}
        nodes.node('rpo_sim', 'fault_injector', remap=name, scenario=path, **share)
        name = {'__node': 'faults_of_states'}
        share |= {'from_topic': 'relative_state', 'to_topic': faulty, 'seed': seed + 1}
        nodes.node('rpo_sim', 'fault_injector', remap=name, scenario=path, **share)
        recorder = nodes.node('rpo_log', 'recorder', output=nodes.folder / 'run')
        pace = {'real_time_factor': factor, 'stale_after_ticks': stale}
        plant = common.free_running_plant(nodes, path, **pace)
        common.ended(plant, recorder)
        flight, values = common.flight_and_status(nodes.folder / 'run')
    found = {verdict.key: verdict for verdict in verdicts(flight)}
    position, velocity = found['hold_error_per_axis_m'], found['hold_speed_per_axis_m_s']
    ticks = flight.scenario.ticks
    cells = (
        f'{rate:.0%}', f'{int(values["held_ticks"]) / ticks:.0%}',
        f'{int(values["stale_ticks"]) / ticks:.1%}', f'{position.value:.3f} m',
        f'{velocity.value:.4f} m/s', f'{metrics.of_flight(flight).energy_n2s:.2f} N²s',
        'yes' if position.holds and velocity.holds else 'NO',
    )  # fmt: skip
    return f'| {" | ".join(cells)} |'


def run(rates: list[float], kinds: list[str], factor: float, seed: int, stale: int) -> None:
    """Run the paper's test at each rate, the same for all kinds, in both directions; print a table.

    It docks if position and velocity in the last 200 s are within the limits of the paper.
    """
    print(f'{", ".join(kinds)}, in both directions; {factor:g} x real time; {common.machine()}')
    print(
        '| rate of each | ticks with an older force | with none | position | velocity | J | docks |'
    )
    print('|---|---|---|---|---|---|---|')
    for rate in rates:
        print(_row(rate, kinds, factor, seed, stale), flush=True)
