# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Command shaping: a slew limit with memory, and a dead zone. Section `shaping`.

It stands between the controller and runtime assurance: assurance has the last word. Each axis is
shaped by itself, so the direction of a large change of force may turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple

from rpo_core.files.validation import Checked, InputError, real
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.jit import kernel, step_kernel
from rpo_core.stage import KernelStage, Place, Section, register
from rpo_core.wire import interfaces

_above = partial(real, above=0.0, most=1e6)
_least = partial(real, least=0.0, most=1e6)


@dataclass(frozen=True)
class Shaping(Checked):
    """What becomes of the command of a controller.

    slew_n_s : largest change of a command per second, each axis; the first command of a flight is
        not limited, as the paper does not count that step
    dead_zone_n : a command of at most so much becomes zero, each axis; 0: none
    """

    slew_n_s: Annotated[float, partial(_above, unit='N/s')]
    dead_zone_n: Annotated[float, partial(_least, unit='N')] = 0.0


@kernel
def shaped(
    command: float, before: float, first: bool, step_n: float, zone: float, most: float
) -> float:
    """Return the shaped command [N] of an axis.

    before : shaped command [N] of the tick before; first : there is none
    step_n : largest change in a tick [N]; zone : dead zone [N]; most : limit of the thrusters [N]
    """
    wanted = saturate(command, most)
    if -zone <= wanted <= zone:
        wanted = 0.0
    if first:
        return wanted
    if wanted > before + step_n:
        return before + step_n
    if wanted < before - step_n:
        return before - step_n
    return wanted


class Limits(NamedTuple):
    """Settings of the kernel `shape` [N]: largest change in a tick, dead zone, of the thrusters."""

    step_n: float
    zone_n: float
    limit_n: float


@dataclass(slots=True)
class Shaped:
    """The last shaped command [N]; is_first : 1 where there is none."""

    force_n: Annotated[list[float], 3]
    is_first: int = 1


@step_kernel
def shape(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """s_k = s_(k-1) + sat(w_k - s_(k-1), slew dt), w = sat(u) outside the dead zone, else 0.

    u, y (3,) : command and shaped command, per axis of target LVLH [N]; s_0 = w_0
    """
    for i in range(3):
        y[i] = shaped(u[i], m.force_n[i], m.is_first != 0, p.step_n, p.zone_n, p.limit_n)
        m.force_n[i] = y[i]
    m.is_first = 0


class ShapingStage(KernelStage):
    """From the command of the controller to the shaped command; it remembers the last one."""

    name = 'shaping'
    inputs = (interfaces.COMMAND,)
    outputs = (interfaces.SHAPED_FORCE,)
    memory_ticks = None
    counts_ticks = False
    kernel = shape

    def __init__(self, settings: Shaping, scenario: Any) -> None:
        slew_n, zone_n = settings.slew_n_s * scenario.dt_s, settings.dead_zone_n
        limits = Limits(slew_n, zone_n, float(scenario.max_force_n))
        super().__init__(limits, Shaped([0.0] * 3))


def _check(settings: Shaping, scenario: Any) -> None:
    """Raise InputError if the dead zone leaves no command."""
    if settings.dead_zone_n >= scenario.max_force_n:
        raise InputError(
            f'`shaping.dead_zone_n` must be below max_force_n = {scenario.max_force_n!r} N; '
            f'got {settings.dead_zone_n!r}'
        )


register(Section('shaping', Shaping, Place.SHAPING, ShapingStage, _check))
