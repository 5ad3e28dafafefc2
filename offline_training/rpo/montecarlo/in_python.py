# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a campaign flies stages that have no kernel, and by what factor that is slower."""

from __future__ import annotations

from time import thread_time
from typing import Any

from rpo.montecarlo.config import Campaign
from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Driver
from rpo_core.kernels.jit import COMPILED, step_kernel
from rpo_core.kernels.records import NOTHING
from rpo_core.stage import KernelStage, Stage, has_kernel

TICKS, REPETITIONS = 100, 3
"""Of a flight, and how often it is flown, to measure."""


@step_kernel
def rest(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Y = 0: a kernel that takes no time."""
    for i in range(len(y)):
        y[i] = 0.0


class Resting(KernelStage):
    """A kernel in the place of a stage that has none."""

    kernel = rest

    def __init__(self, stage: Stage) -> None:
        self.name, self.inputs, self.outputs = stage.name, stage.inputs, stage.outputs
        super().__init__(NOTHING)


def stages(campaign: Campaign) -> list[str]:
    """Return the names of the stages that have no kernel."""
    chain = Chain.of(campaign.scenario, campaign.controller)
    return [link.stage.name for link in chain.links if not has_kernel(link.stage)]


def sentence(campaign: Campaign) -> str:
    """Return which stages fly in Python, and how much slower that is; '' if none does."""
    names = stages(campaign)
    if not names or not COMPILED:
        return ''
    factor = slower(campaign)
    by = f', about {factor:.2g} times slower than with kernels' if factor > 1.0 else ''
    what = f'stage{"s" if names[1:] else ""} {", ".join(f"`{name}`" for name in names)}'
    fly = 'fly' if names[1:] else 'flies'
    return f'{what} {fly} in Python{by}; docs/extend.md shows the form of a kernel'


def slower(campaign: Campaign) -> float:
    """Return the factor of the processor time of some ticks to that with kernels; 0: not known."""
    chain = Chain.of(campaign.scenario, campaign.controller)
    resting = (
        link if has_kernel(link.stage) else link._replace(stage=Resting(link.stage))
        for link in chain.links
    )
    try:
        return _flight_s(campaign, chain) / _flight_s(campaign, Chain(tuple(resting)))
    except (RuntimeError, ZeroDivisionError):  # such a flight may fail: nothing acts in it
        return 0.0


def _flight_s(campaign: Campaign, chain: Chain) -> float:
    """Return the processor time of the first ticks of a flight."""
    driver, start, times_s = Driver(chain), start_of(campaign.scenario), []
    for _ in range(REPETITIONS):
        begun = thread_time()
        driver.fly(start, min(TICKS, campaign.scenario.ticks))
        times_s.append(thread_time() - begun)
    return min(times_s)
