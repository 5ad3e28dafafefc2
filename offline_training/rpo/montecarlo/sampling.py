# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The draws of each run of a campaign: from the seed and the number of the run alone."""

from __future__ import annotations

import math
import zlib
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from rpo.montecarlo.config import Campaign, CampaignConfig
from rpo.montecarlo.quantities import CUT, QUANTITIES, SHELL, Dispersion
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.arrays import Floats, Ints
from rpo_core.navigation.attitude_sensors import AttitudeSensors
from rpo_core.navigation.sensors import Sensors

STRATA = 1000
"""Runs of one Latin hypercube: memory stays flat, and a run is repeated without the others."""

ON_THEIR_OWN = tuple(name for name, quantity in QUANTITIES.items() if quantity.own)
"""Quantities that are drawn each by itself; results have a column of those that are dispersed."""

_DRAWN = [
    name
    for name, quantity in QUANTITIES.items()
    if quantity.distributions != ('white',) and name not in ON_THEIR_OWN
]
_OFFSETS = dict(
    zip(_DRAWN, np.cumsum([0, *(QUANTITIES[n].components for n in _DRAWN)]), strict=False)
)
DIMENSIONS = sum(QUANTITIES[name].components for name in _DRAWN)
"""Numbers drawn per run, dispersed or not: adding a dispersion leaves the others' draws alone."""

_HYPERCUBE, _RUN, _NOISE, _OWN = 0, 1, 2, 3  # first words of the spawn keys of the seed sequences

STARTS = (
    *(f'initial_{axis}_m' for axis in 'xyz'),
    *(f'initial_v{axis}_m_s' for axis in 'xyz'),
)
PARAMETERS = (
    *STARTS,
    'mass_kg',
    *(f'thrust_share_{axis}' for axis in 'xyz'),
    *(f'misalignment_{axis}_rad' for axis in 'xyz'),
    *(f'bias_{axis}_m' for axis in 'xyz'),
    *(f'bias_v{axis}_m_s' for axis in 'xyz'),
    'disturbance_amplitude_share',
    'disturbance_phase_rad',
    'disturbance_frequency_share',
    'orbit_radius_m',
    'delay_ticks',
)
"""Columns of `DrawnRuns.parameters` of every campaign; the state at the start comes first."""


class DrawnRuns(NamedTuple):
    """The draws of some runs.

    numbers : (n,) int
    names : of the columns, `PARAMETERS` and those `ON_THEIR_OWN` that are dispersed
    parameters : (n, columns)
    keys : (n, 2) int, of noise and message faults
    """

    numbers: Ints
    names: tuple[str, ...]
    parameters: Floats
    keys: Ints

    @property
    def starts(self) -> Floats:
        """Initial states (n, 6) [m, m/s], target LVLH."""
        return self.parameters[:, : len(STARTS)]

    def column(self, name: str) -> Floats:
        """Return what was drawn (n,) of one name."""
        return self.parameters[:, self.names.index(name)]

    def some(self, chosen: slice | list[int]) -> DrawnRuns:
        """Return some of the runs."""
        return DrawnRuns(
            self.numbers[chosen], self.names, self.parameters[chosen], self.keys[chosen]
        )


def draw(campaign: Campaign, first: int, count: int) -> DrawnRuns:
    """Return `count` runs from number `first`."""
    config, scenario = campaign.config, campaign.scenario
    numbers = np.arange(first, first + count)
    unit = _unit_draws(campaign, numbers, DIMENSIONS)

    def off(name: str) -> Floats:
        """Deviations (n, components) of a quantity."""
        offset, components = _OFFSETS[name], QUANTITIES[name].components
        u = unit[:, offset : offset + components]
        found = config.dispersions.get(name)
        if found is None:
            return np.zeros((count, components))
        return _deviations(found, u)

    def start(name: str, nominal: Vector) -> Floats:
        """Return starts (n, 3): what was drawn on top of the scenario's, or in its place."""
        found = config.dispersions.get(name)
        if found is not None and found.distribution == SHELL:
            return off(name)
        return np.asarray(nominal + off(name))

    parameters = np.hstack(
        [
            start('initial_position_m', scenario.initial_position_m),
            start('initial_velocity_m_s', scenario.initial_velocity_m_s),
            scenario.mass_kg * (1.0 + off('mass_share')),
            off('thrust_share'),
            off('misalignment_deg') * (math.pi / 180.0),
            off('navigation_position_bias_m'),
            off('navigation_velocity_bias_m_s'),
            off('disturbance_amplitude_share'),
            off('disturbance_phase_rad'),
            off('disturbance_frequency_share'),
            scenario.orbit_radius_m + off('orbit_altitude_m'),
            off('delay_ticks'),
        ]
    )
    names = parameters_of(config)
    own = [
        _deviations(config.dispersions[name], _unit_draws(campaign, numbers, 1, name)[:, 0])
        for name in names[len(PARAMETERS) :]
    ]
    parameters = np.column_stack([parameters, *own])
    return DrawnRuns(numbers, names, parameters, _keys(campaign, numbers))


def _deviations(found: Dispersion, u: Floats) -> Floats:
    """Return the deviations of draws in [0, 1)."""
    if found.distribution == 'whole':
        return np.minimum(np.floor(u * (found.spread[0] + 1.0)), found.spread[0])
    if found.distribution == SHELL:
        return _shell(found, u)
    shape = 2.0 * u - 1.0
    if found.distribution == 'normal':
        shape = ndtri(ndtr(-CUT) + u * (ndtr(CUT) - ndtr(-CUT)))
    return np.asarray(shape * np.array(found.spread))


def _shell(found: Dispersion, u: Floats) -> Floats:
    """Return vectors (n, 3) of any direction, for draws (n, 3) in [0, 1).

    The projection of a sphere on its axis is uniform (Archimedes): height, angle, then length.
    """
    least, most = found.spread
    height, angle = 2.0 * u[:, 0] - 1.0, 2.0 * math.pi * u[:, 1]
    across = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    length = least + (most - least) * u[:, 2]
    ahead = np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
    return np.asarray(ahead * length[:, None])


def parameters_of(config: CampaignConfig) -> tuple[str, ...]:
    """Return the columns of `DrawnRuns.parameters` of a campaign."""
    return (*PARAMETERS, *(name for name in ON_THEIR_OWN if name in config.dispersions))


def _unit_draws(campaign: Campaign, numbers: Ints, width: int, name: str = '') -> Floats:
    """Return draws (n, width) in [0, 1); of one quantity by name, which no other one changes."""
    config, own = campaign.config, _OWN + (zlib.crc32(name.encode()) << 8)
    if config.sampling == 'random':
        purpose = own if name else _RUN
        return np.array([_generator(config.seed, purpose, int(i)).random(width) for i in numbers])
    rows = np.empty((len(numbers), width))
    for block in np.unique(numbers // STRATA).tolist():
        size = min(STRATA, config.runs - block * STRATA)
        rng = _generator(config.seed, own if name else _HYPERCUBE, block)
        cube = qmc.LatinHypercube(width, rng=rng).random(size)
        mine = numbers // STRATA == block
        rows[mine] = cube[numbers[mine] - block * STRATA]
    return rows


def _keys(campaign: Campaign, numbers: Ints) -> Ints:
    """Return keys (n, 2) of noise and message faults; zeros where there are none."""
    config = campaign.config
    noisy = any(d.distribution == 'white' for d in config.dispersions.values())
    keys = np.zeros((len(numbers), 2), np.int64)
    sensed = any(campaign.scenario.section(kind) for kind in (Sensors, AttitudeSensors))
    if noisy or sensed or config.faults is not None:
        for row, number in zip(keys, numbers.tolist(), strict=True):
            row[:] = _sequence(config.seed, _NOISE, number).generate_state(2)
    return keys


def _sequence(seed: int, purpose: int, number: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(purpose, number))


def _generator(seed: int, purpose: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(_sequence(seed, purpose, number)))
