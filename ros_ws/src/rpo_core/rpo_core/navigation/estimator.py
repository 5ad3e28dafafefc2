# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator: a Kalman filter on the relative motion. Section `estimator`.

It reads the measurements and the force that was commanded one tick before. Its arithmetic is in
`rpo_core.navigation.filter_kernels`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import sqrt
from typing import Annotated, Any

import numpy as np

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, flag, real, whole
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table
from rpo_core.navigation import filter_kernels as kf
from rpo_core.navigation.filter_kernels import SQUARE, STATES, X, estimate, numbers_of
from rpo_core.navigation.sensor_kernels import MEASURED, three_normals
from rpo_core.navigation.sensors import PortSeen, Sensors
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import ATTITUDE, PREVIOUS_COMMAND
from rpo_core.world import cw
from rpo_core.world.cw import CwStep, cw_step

_START = 255
"""Stream of the random numbers of the start."""

_above = partial(real, above=0.0, most=1e6)
_least = partial(real, least=0.0, most=1e6)


@dataclass(frozen=True)
class Estimator(Checked):
    """A Kalman filter; it assumes the noise of the sensors that the scenario has.

    position_sigma_m, velocity_sigma_m_s : each axis, of the state at the start: the filter begins
        with the start of the scenario plus an error of that size, drawn with the sensors' key
    acceleration_noise_m_s1_5 : root of the spectral density of what is not modelled, each axis
    noise_scale : sigma of the sensors as the filter takes it, over that of the scenario
    disturbance_sigma_n : of a constant disturbance force at the start, each axis; 0: the filter has
        no such state
    disturbance_walk_n_s0_5 : how the disturbance changes, per root of a second
    compensate : whether the controller subtracts the disturbance that is estimated from its command
    gate_sigmas : a measurement is rejected beyond the chi-square quantile of so many sigmas of a
        normal number; 0: none is
    restart_after : so many rejected measurements in a row restart the filter; 0: none do
    restart_velocity_sigma_m_s : each axis, after a restart
    mass_kg : of the chaser as the filter takes it; 0: as the scenario has it
    delay_ticks : from a command to its force as the filter takes it; -1: as the scenario has it
    thrust_noise_s0_5 : root of the spectral density of the thrust's error, as a share of the
        command, each axis
    """

    position_sigma_m: Annotated[float, partial(_above, unit='m')] = 1.0
    velocity_sigma_m_s: Annotated[float, partial(_above, unit='m/s')] = 0.01
    acceleration_noise_m_s1_5: Annotated[float, partial(_least, unit='m/s^1.5')] = 1e-5
    noise_scale: Annotated[float, partial(real, least=1e-3, most=1e3)] = 1.0
    disturbance_sigma_n: Annotated[float, partial(_least, unit='N')] = 0.0
    disturbance_walk_n_s0_5: Annotated[float, partial(_least, unit='N/s^0.5')] = 0.0
    gate_sigmas: Annotated[float, partial(real, least=0.0, most=100.0)] = 5.0
    restart_after: Annotated[int, partial(whole, least=0, most=1_000_000)] = 20
    restart_velocity_sigma_m_s: Annotated[float, partial(_above, unit='m/s')] = 1.0
    mass_kg: Annotated[float, partial(_least, unit='kg')] = unless_default(0.0)
    delay_ticks: Annotated[int, partial(whole, least=-1, most=1000)] = unless_default(-1)
    compensate: Annotated[bool, flag] = unless_default(False)
    thrust_noise_s0_5: Annotated[float, partial(_least, unit='s^0.5')] = unless_default(0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thrust_noise_s0_5 > 0.0 and self.acceleration_noise_m_s1_5 == 0.0:
            raise InputError('`acceleration_noise_m_s1_5` must be > 0 with `thrust_noise_s0_5`')
        if self.disturbance_walk_n_s0_5 > 0.0 and self.disturbance_sigma_n == 0.0:
            raise InputError('`disturbance_sigma_n` must be > 0 N where the disturbance walks')
        if self.compensate and self.disturbance_sigma_n == 0.0:
            raise InputError(
                '`disturbance_sigma_n` must be > 0 N to `compensate` the disturbance; got 0'
            )

    @property
    def states(self) -> int:
        """6 states, or 9 with a disturbance."""
        return 9 if self.disturbance_sigma_n > 0.0 else 6


def gate(numbers: int, sigmas: float) -> float:
    """Return the chi-square quantile of so many numbers; 0 for none.

    By Wilson and Hilferty, "The distribution of chi-square", 1931: right to 12 % up to 5 sigmas,
    and made of + - * / sqrt.
    """
    if sigmas == 0.0 or numbers == 0:
        return 0.0
    share = 2.0 / (9.0 * numbers)
    root = 1.0 - share + sigmas * sqrt(share)
    return numbers * root * root * root


def filter_of(settings: Estimator, sensors: Sensors, scenario: Any) -> Any:
    """Return the settings of a scenario's filter, a table of `navigation.filter_kernels`."""
    n, units = settings.states, sensors.units
    rows = np.array([unit.row(scenario.dt_s) for unit in units])
    rows[:, :5] *= settings.noise_scale
    first, second = (three_normals(0, i, _START, *sensors.noise_key) for i in range(2))
    sigmas = [settings.position_sigma_m] * 3 + [settings.velocity_sigma_m_s] * 3
    draws = zip(scenario.start, sigmas, (*first, *second), strict=True)
    start = [value + sigma * draw for value, sigma, draw in draws] + [0.0] * 3
    disturbed = [settings.disturbance_sigma_n] * 3
    again = [settings.position_sigma_m] * 3 + [settings.restart_velocity_sigma_m_s] * 3
    mass_kg = settings.mass_kg or scenario.mass_kg
    step = cw.discretise(scenario.mean_motion_rad_s, mass_kg, scenario.dt_s)
    delay_ticks = int(getattr(scenario.thrusters, 'delay_ticks', 0))
    gust = settings.thrust_noise_s0_5
    if gust > 0.0:
        gust /= settings.acceleration_noise_m_s1_5 * mass_kg
    table = [
        n,
        scenario.max_force_n,
        delay_ticks if settings.delay_ticks < 0 else settings.delay_ticks,
        settings.restart_after,
        max(unit.latency_ticks for unit in units),
        1,  # the covariance is wanted
        len(units),
        float(sensors.turn or sensors.look),
        gust * gust,
        *step,
        *(gate(numbers, settings.gate_sigmas) for numbers in range(7)),
        *start,
        *_process_noise(settings, step, mass_kg, scenario.dt_s).ravel(),
        *np.diag(np.square([*sigmas, *disturbed])).ravel(),
        *np.diag(np.square([*again, *disturbed])).ravel(),
        *rows.ravel(),
    ]
    return as_table(table)


def _process_noise(settings: Estimator, step: CwStep, mass_kg: float, dt_s: float) -> Floats:
    """Return Q (9, 9): white acceleration, held for a tick; the walk of the disturbance."""
    density, walk = settings.acceleration_noise_m_s1_5 * mass_kg, settings.disturbance_walk_n_s0_5
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    columns = [cw_step((0.0,) * 6, force, step) for force in unit]
    noise = np.diag([0.0] * 6 + [walk * walk * dt_s] * 3)
    noise[:6, :6] = density * density / dt_s * sum(np.outer(column, column) for column in columns)
    return noise


def memory_of(f: Any) -> Any:
    """Return the memory of a filter not begun, a table of `navigation.filter_kernels`."""
    return as_table([-1.0] * X + [0.0] * (numbers_of(f) - X))


class FilterStage(Stage):
    """A filter in the chain: its table of settings, its memory, and how it fares.

    The memory begins with the counts of `filter_kernels`, those of the attitude filter too.

    title, silence : of the filter in words, and what it says of ticks without a measurement
    """

    memory_ticks = None
    title: str
    silence: str

    filter: Any
    memory: Any
    _silent_ticks: int

    def trouble(self) -> str:
        """Return what is wrong, for /diagnostics; '' if nothing is."""
        if self.restarts > 0:
            return (
                f'the {self.title} diverged: it was restarted {self.restarts} times, the last time '
                f'at tick {int(self.memory[kf.LAST_RESET])}'
            )
        silent = int(self.memory[kf.BASE] - self.memory[kf.LAST_ACCEPTED])
        if self.memory[kf.NOW] >= 0 and silent > self._silent_ticks:
            return f'the {self.title} is coasting: {self.silence} for {silent} ticks'
        return ''

    @property
    def restarts(self) -> int:
        """How often it was restarted."""
        return max(0, int(self.memory[kf.RESETS]))


class EstimatorStage(FilterStage):
    """From measurements and the command before to the estimated state and its covariance."""

    name = title = 'estimator'
    silence = 'no measurement was taken'
    outputs: tuple[str, ...] = (interfaces.NAVIGATION_STATE, interfaces.NAVIGATION_COVARIANCE)

    def __init__(self, settings: Estimator, scenario: Any) -> None:
        sensors = scenario.named('sensors')
        self.inputs = (PREVIOUS_COMMAND, *sensors.signals)
        self.filter = filter_of(settings, sensors, scenario)
        self._silent_ticks = 10 * max(unit.period_ticks for unit in sensors.units)
        self._states = settings.states
        self._measured = as_table(np.zeros(MEASURED * len(sensors.units)))
        self._count, self._attitude = len(sensors.units), as_table([0.0] * kf.HEADING)
        self._port = PortSeen(sensors, scenario, known=True)
        if sensors.turn:
            known = scenario.named('attitude_estimator') is not None
            self.inputs += (ATTITUDE, *([interfaces.ATTITUDE_COVARIANCE] if known else []))
        if self._states == STATES:
            self.outputs = (*self.outputs, interfaces.ESTIMATED_DISTURBANCE)
        self.reset()

    def reset(self) -> None:
        """Begin with the start of the scenario."""
        self.memory = memory_of(self.filter)

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return state (6,) [m, m/s], covariances (18,), and the disturbance (3,) [N] if any.

        The covariances are those of position [m^2] and of velocity [m^2/s^2], 3 x 3 each.
        """
        command, measurements = inputs[0], inputs[1 : 1 + self._count]
        if len(inputs) > 1 + self._count:
            self._attitude[:4] = inputs[1 + self._count][:4]
        if len(inputs) > 2 + self._count:
            self._attitude[4 : kf.PORT] = inputs[2 + self._count]
        self._port.put(tick, self._attitude, kf.PORT)
        for i, values in enumerate(measurements):
            self._measured[MEASURED * i] = float(values[6] >= 0.0)
            self._measured[MEASURED * i + 1 : MEASURED * (i + 1)] = values[:6]
        estimate(tick, command, self._measured, self._attitude, self.filter, self.memory)
        y, p = tuple(map(float, self.memory[X : X + STATES])), self.covariance
        spread = (*p[:3, :3].ravel().tolist(), *p[3:6, 3:6].ravel().tolist())
        return (y[:6], spread) if self._states == 6 else (y[:6], spread, y[6:])

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that the state is what the first sensor measured; all else is zero."""
        return (1, (), ())[: len(self.outputs)]

    @property
    def covariance(self) -> Floats:
        """Whole covariance (n, n) of the newest estimate; SI units."""
        n, table = self._states, self.memory[X + STATES : X + STATES + SQUARE]
        return np.array(table).reshape(STATES, STATES)[:n, :n]

    @property
    def innovations(self) -> list[list[float]]:
        """Per sensor, innovations over sigma of what was measured newly; empty if nothing was."""
        rows = [kf.TESTED + kf.TESTS * i for i in range(int(self.filter[kf.UNITS]))]
        ends = [row + 2 + int(self.memory[row]) for row in rows]
        tested = zip(rows, ends, strict=True)
        return [list(map(float, self.memory[row + 2 : end])) for row, end in tested]

    @property
    def rejected(self) -> int:
        """How many measurements were rejected."""
        return max(0, int(self.memory[kf.REJECTED]))


def _check(_settings: Estimator, scenario: Any) -> None:
    """Raise InputError if another stage makes the navigation state."""
    if scenario.named('navigation') is not None:
        raise InputError('`estimator` must be alone: `navigation` makes a navigation state too')


register(
    Section(
        'estimator',
        Estimator,
        Place.ESTIMATOR,
        EstimatorStage,
        _check,
        needs=('sensors', 'something to measure'),
    )
)
