# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a flight that no node flew: the messages are those that the nodes publish."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rpo_core.chain.flight import Flight
from rpo_core.judge.metrics import run_figures
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import CLOCK, DUE_FORCE, EVENT, RUN_STATUS
from rpo_core.wire.statuses import FINISHED, RUNNING
from rpo_log import provenance, signature
from rpo_log.errors import LogError
from rpo_log.format.run import RunSummary, TimeBase
from rpo_log.write.writer import RunLogWriter


def record(
    flight: Flight, attachments: Mapping[str, bytes], folder: Path, *, overwrite: bool = False
) -> RunSummary:
    """Write the run folder of a flight in lockstep; raises LogError.

    flight : as `rpo_core.chain.flight.fly` returns it, with all signals
    attachments : scenario.yaml and controller.yaml that it flew, parameters.yaml
    """
    flown = flight.scenario
    base = TimeBase.of(flown)
    arrays = {interfaces.RELATIVE_STATE: flight.states, interfaces.CONTROL_FORCE: flight.forces_n}
    if not flown.disturbance.is_zero:
        arrays[interfaces.DISTURBANCE_FORCE] = flight.disturbances_n
    values = {name: array.tolist() for name, array in {**arrays, **flight.signals}.items()}
    values[CLOCK] = [[]] * (base.last_tick + 1)
    rows = [row for row in interfaces.rows(logged=True) if row.name in values]
    events = [
        row
        for row in interfaces.rows(logged=True)
        if row.due == EVENT and (not row.beside or row.beside in values)
    ]
    topics = {row.name: f'/{row.topic.lstrip("/")}' for row in (*rows, *events)}
    layouts = {row.name: row.layout_in(flown) for row in rows}
    log = RunLogWriter(folder, base, topics.values(), attachments, overwrite=overwrite)
    for tick in range(base.last_tick + 1):
        stamp = base.stamp_ns(tick)
        for row in rows:
            rider = values[row.rider][tick] if row.rider in values else []
            data = layouts[row.name].encode(stamp, [*values[row.name][tick], *rider])
            log.write(topics[row.name], tick, data)
        if tick in (0, base.last_tick):
            log.write(topics[RUN_STATUS], tick, _status(flight, tick))
    summary = log.close()
    if not summary.whole:
        raise LogError(folder, summary.sentence())
    provenance.write_run_info(folder, {'messages': dict(summary.messages)})
    signature.write_sums(folder)
    return summary


def _status(flight: Flight, tick: int) -> bytes:
    """Return the run_status of the plant at the first or the last tick."""
    phase, said = (RUNNING, 'flying') if tick == 0 else (FINISHED, 'reached the last tick')
    taken, due = flight.saturated_forces_n[:tick], flight.signals[DUE_FORCE][:tick]
    squares = [0.0, 0.0, 0.0]
    for force_n in taken.tolist():  # in the order of the ticks, as the plant adds them up
        squares = [total + force * force for total, force in zip(squares, force_n, strict=True)]
    state, saturated = flight.states[tick].tolist(), int((taken != due).any(axis=1).sum())
    figures = run_figures(flight.scenario, tick, state, squares, saturated)
    texts = {name: repr(figure) for name, figure in figures.items()}
    return cdr.encode_status(0, 'run', said, 'none', {'phase': phase, **texts})
