# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Latency and jitter of plant, controller and recorder in free running, at some rates."""

from __future__ import annotations

from tools.trials import common

RATES_HZ = (10.0, 50.0, 100.0)

_COLUMNS = ('latency_p50', 'latency_p95', 'latency_max', 'tick_lateness_p95', 'tick_lateness_max')
_COUNTS = ('overruns', 'held_ticks', 'stale_ticks')


def _row(rate_hz: float, seconds: float) -> str:
    with common.trial_nodes() as nodes:
        path = common.scenario(nodes.folder, 'approach', dt_s=1.0 / rate_hz, duration_s=seconds)
        nodes.node('rpo_ctrl', 'fuzzy_controller')
        recorder = nodes.node('rpo_log', 'recorder', output=nodes.folder / 'run')
        plant = common.free_running_plant(nodes, path)
        common.ended(plant, recorder)
        _, values = common.flight_and_status(nodes.folder / 'run')
    cells = [f'{rate_hz:g} Hz', values['tick']]
    cells += [f'{float(values[f"{name}_ms"]):.2f} ms' for name in _COLUMNS]
    cells += [values[name] for name in _COUNTS]
    return f'| {" | ".join(cells)} |'


def run(rates_hz: list[float], seconds: float) -> None:
    """Run at each rate for some seconds of real time, and print a row of the table."""
    print(common.machine())
    print(
        '| rate | ticks | latency p50 | p95 | max | tick late p95 | max | overruns | held | zero |'
    )
    print('|---|---|---|---|---|---|---|---|---|---|')
    for rate_hz in rates_hz:
        print(_row(rate_hz, seconds), flush=True)
