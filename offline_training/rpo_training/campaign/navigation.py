# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors and filters of drawn runs, as the engine flies them side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.scenario import Scenario
from rpo_nav.estimator import Estimator, filter_of, memory_of
from rpo_nav.sensors import Sensing, Sensors
from rpo_training.engine.parts import RUNS
from rpo_training.engine.parts import Estimators as Part


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
    memory = memory_of(one._replace(delay=slots - one.newest - 2))

    def each(values: Sequence[Any]) -> NDArray[Any]:
        """Return a row for each of 40 lanes; lanes without a run are copies of the first."""
        given = [np.array(value) for value in values]
        return np.stack([*given, *([given[0]] * (RUNS - len(given)))])

    def rooms(value: Any) -> NDArray[Any]:
        return each([np.zeros_like(np.array(value))])

    return Part(
        rows=each([x.rows for x in sensing]),
        told=each([f.sensors for f in filters]),
        outages=np.array(first.outages),
        keys=each([np.array(x.key, np.int64) for x in sensing]),
        walk=rooms(first.walk), queue=rooms(first.queue), out=np.array(first.out),
        n=one.n,
        steps=each([tuple(f.step) for f in filters]),
        noise=each([f.noise for f in filters]),
        start=each([f.start for f in filters]),
        spread=each([f.spread for f in filters]),
        again=each([f.again for f in filters]),
        gates=np.array(one.gates),
        limit=one.limit_n,
        delays=each([np.int64(f.delay) for f in filters]),
        patience=one.patience,
        newest=one.newest,
        x=rooms(memory.x), p=rooms(memory.p), y=rooms(memory.y), s=rooms(memory.s),
        work=np.array(memory.work),
        commands=rooms(memory.commands), pending=rooms(memory.pending),
        counts=rooms(memory.counts),
        tested=np.array(memory.tested),
        command=np.zeros((RUNS, 3)),
    )  # fmt: skip
