# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The flight that a log shows, also where the log ends early: aborts are what people look at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, cast

import numpy as np

from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import Flight
from rpo_core.judge.verdicts import missed, unbounded, verdicts
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Stage
from rpo_core.wire import interfaces
from rpo_log.read.run_log import RunLog, flight_of, flown_of, scenario_of
from rpo_log.verify.recomputation import StageStates

AnyStage = TypeVar('AnyStage', bound=Stage)

LEAST_TICKS = 10
"""A log that shows less from the start is not drawn."""


@dataclass(frozen=True)
class LoggedFlight:
    """A flight beside its plan.

    flight : as far as the log shows it without a gap; its scenario ends there
    planned : the scenario as it should have been flown
    gaps : why the log does not show a whole flight; empty if it does
    lacks : what a bag does not hold beside the flight, and a log does
    """

    flight: Flight
    planned: Scenario
    gaps: tuple[str, ...]
    lacks: tuple[str, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether the flight went to its end and the log shows it."""
        return not self.gaps


def logged_flight(log: RunLog) -> LoggedFlight:
    """Return what a log shows; LogError if that is less than `LEAST_TICKS` from the start."""
    planned = scenario_of(log)
    flight = flown_of(log, planned)
    ticks = _shown_ticks(log, flight)
    if log.complete or ticks < LEAST_TICKS:
        return LoggedFlight(flight_of(log), planned, (), log.lacks)
    return LoggedFlight(until(flight, ticks), planned, log.gaps, log.lacks)


def until(flight: Flight, ticks: int) -> Flight:
    """Return a flight as far as a tick."""
    shown = slice(0, ticks + 1)
    return Flight(
        replace(flight.scenario, duration_s=flight.scenario.time_s(ticks)),
        flight.states[shown],
        flight.forces_n[shown],
        flight.disturbances_n[shown],
        {name: values[shown] for name, values in flight.signals.items()},
        flight.events,
    )


def _shown_ticks(log: RunLog, flight: Flight) -> int:
    """Return the last tick up to which every state and force is there."""
    columns = [flight.states, flight.forces_n, flight.disturbances_n, flight.sent_forces_n]
    present = np.isfinite(np.hstack(columns)).all(axis=1)
    present &= log.ticks == np.arange(len(log.ticks))
    return int(np.argmin(present) if not present.all() else len(present)) - 1


def verdict_of(flight: Flight, gaps: Sequence[str] = ()) -> str:
    """Return the verdict of a flight in words: what it misses, or which limit is the tightest."""
    if gaps:
        return f'Not judged: {"; ".join(gaps)}.'
    judged = verdicts(flight)
    if not judged:
        return 'The scenario has no requirements.'
    names = ', '.join(unbounded(flight.scenario))
    rest = f' No requirement bounds {names}.' if names else ''
    if missed(flight):
        bad = [verdict for verdict in judged if verdict.holds is False]
        said = '; '.join(f'{v.statement}: {v.reached}' for v in bad)
        return f'{len(bad)} of {len(judged)} requirements missed. {said}.{rest}'
    few = {1: 'The requirement holds.', 2: 'Both requirements hold.'}
    said = few.get(len(judged), f'All {len(judged)} requirements hold.')
    if tight := [verdict for verdict in judged if verdict.limit > 0.0 and verdict.holds]:
        v = max(tight, key=lambda verdict: verdict.value / verdict.limit)
        said += f' The tightest is {v.statement}: {v.reached}.'
    return said + rest


def steps_again(
    log: RunLog, flight: Flight, stage_type: type[AnyStage]
) -> Iterator[tuple[int, AnyStage, list[tuple[float, ...]]]]:
    """Yield (tick, stage, outputs) of the stage of a kind, run again on its logged inputs.

    It gets the commands that it got in flight. Nothing is yielded where the scenario has no such
    stage, an input of a tick is missing, or the stage was switched off.
    """
    chain = Chain.of(scenario_of(log))  # as planned: a bound may hold for the whole flight
    links = [link for link in chain.links if isinstance(link.stage, stage_type)]
    if not links:
        return
    stage, ticks = cast(AnyStage, links[0].stage), len(flight.states)
    read = [_logged(log, name)[:ticks] for name in links[0].reads]
    if not all(np.isfinite(values).all() for values in read):
        return
    states = StageStates()
    states.take(log.events)
    if not states.active(stage.name, np.arange(ticks)).all():
        return
    stage.reset()
    for at, state in states.commands(stage.name):
        stage.take_event(at, state)
    for tick in range(ticks):
        inputs = [tuple(values[tick].tolist()) for values in read]
        yield tick, stage, list(stage.step(tick, *inputs))


def _logged(log: RunLog, read: str) -> Floats:
    """Return a signal that a stage reads, (n, width); one of the tick before begins with zero."""
    name = interfaces.current(read)
    nothing = np.full((len(log.ticks), 1), np.nan)
    if name == read:
        return log.values.get(name, nothing)
    sent = log.values.get(interfaces.APPLIED_FORCE, log.values.get(name, nothing))
    return np.vstack([np.zeros((1, sent.shape[1])), sent])
