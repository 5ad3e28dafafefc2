# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Plans and runtime assurance of drawn runs, as the engine flies them side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpo_core.chain.chain import Chain
from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_core.kernels import State
from rpo_core.wire.interfaces import RELATIVE_STATE
from rpo_guidance.guidance import GuidanceStage
from rpo_guidance.plan import Guidance
from rpo_montecarlo.engine.parts import RUNS, Assured, Guiding
from rpo_safety.assurance import AssuranceStage
from rpo_safety.settings import Assurance


def seen_at_start(scenario: Scenario) -> State:
    """Return the first state (6,) that guidance and assurance of a scenario see."""
    chain = Chain.of(scenario)
    before = chain.before(Place.GUIDANCE)
    signals = {RELATIVE_STATE: tuple(map(float, scenario.start))}
    before.reset()
    before.step(0, signals)
    after = chain.part(Place.GUIDANCE, Place.ASSURANCE)
    x, y, z, vx, vy, vz = signals[after.links[0].reads[0]]
    return x, y, z, vx, vy, vz


def guiding_of(scenarios: Sequence[Scenario], seen: Sequence[State]) -> Guiding | None:
    """Return the references of up to 40 runs from the states that they see; None without plan."""
    settings = scenarios[0].section(Guidance)
    if settings is None:
        return None
    ticks = scenarios[0].ticks
    table, last = np.zeros((ticks + 1, 9, RUNS)), np.zeros(RUNS, np.int64)
    for i, (scenario, state) in enumerate(zip(scenarios, seen, strict=True)):
        own = scenario.section(Guidance)
        assert own is not None
        table[:, :, i], last[i] = GuidanceStage(own, scenario).rows(state, ticks)
    port = np.array([*settings.port_m, *settings.corridor.ahead, settings.past_port_m])
    return Guiding(table, last, port, np.zeros(RUNS, np.bool_))


def assured_of(scenarios: Sequence[Scenario], seen: Sequence[State]) -> Assured | None:
    """Return the assurance of up to 40 runs; lanes without a run are copies of the first."""
    if scenarios[0].section(Assurance) is None:
        return None
    tables, modes, delays = [], [], []
    for scenario, state in zip(scenarios, seen, strict=True):
        settings = scenario.section(Assurance)
        assert settings is not None
        stage = AssuranceStage(settings, scenario)
        tables.append(stage.numbers)
        modes.append(stage.mode_of(stage.ahead(state)))
        delays.append(stage.delay_ticks)
    some = [*range(len(scenarios)), *[0] * (RUNS - len(scenarios))]
    return Assured(
        np.array(tables)[some],
        np.array(modes)[some],
        np.array(delays)[some],
        np.zeros((RUNS, max(1, *delays), 3)),
        np.zeros((RUNS, 13)),
    )
