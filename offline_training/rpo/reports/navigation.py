# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator of a run: its errors beside what it says of them, and its innovations.

The filter is run again on the logged measurements and commands: a message has no whole covariance.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo.reports.logged import steps_again
from rpo.reports.page import Section, Table, picture
from rpo_core.chain.flight import Flight
from rpo_core.kernels.arrays import Floats
from rpo_core.navigation.estimator import EstimatorStage
from rpo_log.read.run_log import RunLog
from rpo_log.show import style
from rpo_log.show.report import by_axis

NEES_95 = (1.237, 14.449)
"""Chi-square quantiles of 2.5 % and 97.5 % of 6 degrees of freedom."""


class Filtered(NamedTuple):
    """What the filter of a run did.

    errors, sigmas : (n, 6) estimated less true, and the filter's own sigma [m, m/s]
    nees : (n,) of the six states
    estimates : (n, 9) position, and the Cholesky factor of its covariance, as `Replayed` has it
    innovations : (m, 2) tick and innovation over sigma, of every number measured
    nis : (k, 2) how many numbers a measurement has, and its NIS
    rejected, restarts : counts
    """

    errors: Floats
    sigmas: Floats
    nees: Floats
    estimates: Floats
    innovations: Floats
    nis: Floats
    rejected: int
    restarts: int


def filtered(log: RunLog, flight: Flight) -> Filtered | None:
    """Return what the filter of a run did; None if there is none, or a message is missing."""
    n, stage = len(flight.states), None
    errors, sigmas, nees = np.empty((n, 6)), np.empty((n, 6)), np.empty(n)
    estimates, corner = np.empty((n, 9)), np.tril_indices(3)
    innovations, nis = [], []
    for tick, stage, (state, *_) in steps_again(log, flight, EstimatorStage):
        covariance = stage.covariance[:6, :6]
        errors[tick] = np.array(state) - flight.states[tick]
        sigmas[tick] = np.sqrt(np.diag(covariance))
        nees[tick] = errors[tick] @ np.linalg.solve(covariance, errors[tick])
        factor = np.linalg.cholesky(covariance[:3, :3])
        estimates[tick] = [*state[:3], *factor[corner]]
        for found in filter(None, stage.innovations):
            innovations += [(tick, value) for value in found]
            nis.append((len(found), float(np.square(found).sum())))
    if stage is None:
        return None
    scaled, sums = np.array(innovations).reshape(-1, 2), np.array(nis).reshape(-1, 2)
    return Filtered(errors, sigmas, nees, estimates, scaled, sums, stage.rejected, stage.restarts)


def sections(flight: Flight, found: Filtered | None) -> list[Section]:
    """Return the section of a report; none if the run has no estimator."""
    if found is None:
        return []
    low, high = NEES_95
    inside = 100.0 * ((low <= found.nees) & (found.nees <= high)).mean()
    rows = [
        ('NEES of six states, mean; 6 is right', f'{found.nees.mean():.2f}'),
        (f'ticks with NEES in [{low}, {high}]; 95 % is right', f'{inside:.1f} %'),
        ('measurements taken or rejected', f'{len(found.nis)}'),
        ('rejected', f'{found.rejected}'),
        ('restarts', f'{found.restarts}'),
    ]
    if len(found.nis):
        per_number = float(found.nis[:, 1].sum() / found.nis[:, 0].sum())
        rows.insert(2, ('NIS of a number, mean; 1 is right', f'{per_number:.3f}'))
    table = Table('The filter', ('quantity', 'value'), tuple(rows))
    shown = picture('navigation', _picture(flight, found), nees=found.nees.mean())
    return [Section('Navigation', (table, shown))]


def _picture(flight: Flight, found: Filtered) -> Any:
    times = flight.scenario.times_s[: len(found.errors)]
    figure, panels = style.new_panels(8.4, 4, 1, sharex=True)
    for axes, at, label in (
        (panels[0], 0, 'position error [m]'),
        (panels[1], 3, 'velocity error [m/s]'),
    ):
        by_axis(axes, times, found.errors[:, at : at + 3], label, 0.8)
        most = 3.0 * found.sigmas[:, at : at + 3].max(axis=1)
        for sign in (-1.0, 1.0):
            name = '3 sigma, largest axis' if sign > 0 else None
            axes.plot(times, sign * most, **style.LIMIT, label=name)
        shown = 1.5 * float(np.quantile(most, 0.95))
        axes.set_ylim(-shown, shown)
    panels[2].plot(times, found.nees, color=style.AXES[0], linewidth=0.6)
    panels[2].set(ylabel='NEES', ylim=(0.0, 2.0 * NEES_95[1]))
    ticks, values = found.innovations.T
    panels[3].plot(times[ticks.astype(int)], values, '.', color=style.AXES[1], markersize=1.5)
    panels[3].set(ylabel='innovation / sigma', xlabel='time [s]', ylim=(-6.0, 6.0))
    for axes, bounds in ((panels[2], NEES_95), (panels[3], (-1.96, 1.96))):
        for value in bounds:
            axes.axhline(value, **style.LIMIT)
    style.legend_below(figure, panels[0])
    return figure
