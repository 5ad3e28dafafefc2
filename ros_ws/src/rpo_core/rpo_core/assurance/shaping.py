# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Command shaping: a slew limit with memory, and a dead zone. Section `shaping`.

It stands between the controller and runtime assurance: assurance has the last word. Each axis is
shaped by itself, so the direction of a large change of force may turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from rpo_core.files.validation import Checked, InputError, real
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.jit import kernel
from rpo_core.stage import ZERO, Place, Section, Signal, Stage, register
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


class ShapingStage(Stage):
    """From the command of the controller to the shaped command; it remembers the last one.

    numbers : (3,) largest change in a tick, dead zone, limit of the thrusters [N]
    """

    name = 'shaping'
    inputs = (interfaces.COMMAND,)
    outputs = (interfaces.SHAPED_FORCE,)
    memory_ticks = None
    counts_ticks = False

    def __init__(self, settings: Shaping, scenario: Any) -> None:
        self.numbers = (
            settings.slew_n_s * scenario.dt_s,
            settings.dead_zone_n,
            float(scenario.max_force_n),
        )
        self.reset()

    def reset(self) -> None:
        """Forget the last command: a flight begins."""
        self._before: Signal = ZERO
        self._first = True

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the shaped command (3,) [N]."""
        pairs = zip(inputs[0], self._before, strict=True)
        self._before = tuple(shaped(u, b, self._first, *self.numbers) for u, b in pairs)
        self._first = False
        return (self._before,)


def _check(settings: Shaping, scenario: Any) -> None:
    """Raise InputError if the dead zone leaves no command."""
    if settings.dead_zone_n >= scenario.max_force_n:
        raise InputError(
            f'`shaping.dead_zone_n` must be below max_force_n = {scenario.max_force_n!r} N; '
            f'got {settings.dead_zone_n!r}'
        )


register(Section('shaping', Shaping, Place.SHAPING, ShapingStage, _check))
