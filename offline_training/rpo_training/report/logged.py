# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The flight that a log shows, also where the log ends early: aborts are what people look at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpo_core.flight import Flight
from rpo_core.scenario import Scenario
from rpo_log.read.run_log import RunLog, flight_of, other_signals, scenario_of

LEAST_TICKS = 10
"""A log that shows less from the start is not drawn."""


@dataclass(frozen=True)
class LoggedFlight:
    """A flight beside its plan.

    flight : as far as the log shows it without a gap; its scenario ends there
    planned : the scenario as it should have been flown
    gaps : why the log does not show a whole flight; empty if it does
    """

    flight: Flight
    planned: Scenario
    gaps: tuple[str, ...]

    @property
    def whole(self) -> bool:
        """Whether the flight went to its end and the log shows it."""
        return not self.gaps


def logged_flight(log: RunLog) -> LoggedFlight:
    """Return what a log shows; LogError if that is less than `LEAST_TICKS` from the start."""
    planned = scenario_of(log)
    ticks = _shown_ticks(log)
    if log.complete or ticks < LEAST_TICKS:
        return LoggedFlight(flight_of(log), planned, ())
    shown = slice(0, ticks + 1)
    disturbances = log.disturbances_n
    flight = Flight(
        replace(planned, duration_s=planned.time_s(ticks)),
        log.states[shown],
        log.forces_n[shown],
        np.zeros((ticks + 1, 3)) if disturbances is None else disturbances[shown],
        {name: values[shown] for name, values in other_signals(log).items()},
    )
    return LoggedFlight(flight, planned, log.gaps)


def _shown_ticks(log: RunLog) -> int:
    """Return the last tick up to which every state and force is there."""
    columns = [log.states, log.forces_n]
    if log.disturbances_n is not None:
        columns.append(log.disturbances_n)
    present = np.isfinite(np.hstack(columns)).all(axis=1)
    present &= log.ticks == np.arange(len(log.ticks))
    return int(np.argmin(present) if not present.all() else len(present)) - 1
