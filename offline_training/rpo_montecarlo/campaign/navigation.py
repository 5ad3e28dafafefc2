# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors and filters of drawn runs, as the engine flies them side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_montecarlo.engine import navigation
from rpo_montecarlo.engine.parts import RUNS
from rpo_montecarlo.engine.parts import Estimators as Part
from rpo_nav.estimator import Estimator, filter_of
from rpo_nav.sensor_kernels import MEASURED
from rpo_nav.sensors import Sensing, Sensors


def estimators_of(scenarios: Sequence[Scenario]) -> Part | None:
    """Return the sensors and filters of up to 40 runs; None where there is no estimator."""
    if scenarios[0].section(Estimator) is None:
        return None
    sensing, filters = [], []
    for s in scenarios:
        sensors, settings = s.section(Sensors), s.section(Estimator)
        assert sensors is not None and settings is not None
        sensing.append(Sensing(sensors, s))
        filters.append(filter_of(settings, sensors, s))
    first, one = sensing[0], filters[0]
    slots = max(f.newest + f.delay + 2 for f in filters)

    def each(values: Sequence[Any]) -> NDArray[Any]:
        """Return tables with 40 lanes as their last axis; lanes without a run are the first's."""
        given = [np.array(value) for value in values]
        return np.stack([*given, *([given[0]] * (RUNS - len(given)))], axis=-1)

    rows = np.zeros((navigation.ROWS, RUNS))
    rows[navigation.START : navigation.SPREAD] = each([_nine(f.start) for f in filters])
    for at, name in (
        (navigation.SPREAD, 'spread'),
        (navigation.AGAIN, 'again'),
        (navigation.NOISE, 'noise'),
    ):
        rows[at : at + navigation.SQUARE] = each([_nine(getattr(f, name)) for f in filters])
    return Part(
        shared=np.array(first.rows),
        true=each([x.rows for x in sensing]),
        told=each([f.sensors for f in filters]),
        outages=np.array(first.outages),
        keys=each([np.array(x.key, np.int64) for x in sensing]),
        walk=np.zeros((len(first.rows), 3, RUNS)),
        queue=np.zeros((len(first.rows), one.newest + 1, MEASURED, RUNS)),
        n=one.n,
        gates=np.array(one.gates),
        limit=one.limit_n,
        patience=one.patience,
        newest=one.newest,
        delay=each([np.int64(f.delay) for f in filters]),
        steps=each([tuple(f.step) for f in filters]).ravel(),
        force=np.zeros(3 * RUNS),
        rows=rows,
        commands=np.zeros((slots, 3, RUNS)),
        rejected=np.zeros(RUNS, np.int64),
        compensate=scenarios[0].compensated,
    )


def _nine(values: Any) -> NDArray[np.float64]:
    """Return a state (n,) or covariance (n * n,) with room for nine states, flat."""
    given = np.array(values)
    n = 6 if len(given) in (6, 36) else 9
    table = given.reshape(-1, n)
    return np.pad(table, [(0, 9 - n) if len(table) > 1 else (0, 0), (0, 9 - n)]).ravel()
