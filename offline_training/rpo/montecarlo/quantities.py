# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a campaign can disperse, and how far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from rpo_core.attitude.target import FIXED, TUMBLE
from rpo_core.files.validation import InputError, mapping, real, shown, whole
from rpo_core.world.dynamics import CLOHESSY_WILTSHIRE

CUT = 3.0
"""Normal dispersions are cut at so many standard deviations."""


class Need(NamedTuple):
    """What a scenario must have, in words, so that a dispersion changes a flight."""

    what: str
    is_met: Callable[[Any], Any]


class Quantity(NamedTuple):
    """A quantity that can be dispersed; most : largest deviation that is accepted.

    need : what a scenario must have, if not every one has it
    own : drawn by itself; results have a column of it where it is dispersed
    """

    components: int
    unit: str
    distributions: tuple[str, ...]
    most: float
    need: Need | None = None
    own: bool = False


def _share(most: float, need: Need | None = None, unit: str = '', own: bool = True) -> Quantity:
    """Return a quantity of one number, most often one that is drawn by itself."""
    return Quantity(1, unit, _SPREADS, most, need, own)


def _axes(name: str, most: float, need: Need, unit: str) -> dict[str, Quantity]:
    """Return a quantity for each axis, which stands for `{}` in their name."""
    return {name.format(axis): _share(most, need, unit) for axis in 'xyz'}


def _section(name: str) -> Need:
    return Need(f'`{name}`', lambda scenario: scenario.named(name) is not None)


_DISTURBED = Need('such disturbance', lambda s: not s.disturbance.is_zero)
_PERIODIC = Need('such disturbance', lambda s: any(h.amplitude_n for h in s.disturbance.harmonics))
_ORBIT = Need('orbit but a circle', lambda s: s.dynamics and s.dynamics.kind != CLOHESSY_WILTSHIRE)
_DRAG = Need('drag', lambda s: s.dynamics and s.dynamics.drag)
_PULSES = Need('`pulses` of thrusters', lambda s: s.thrusters and s.thrusters.fires)
_TURNS = Need('`target` that turns', lambda s: s.target and s.target.kind != FIXED)
_TUMBLES = Need('`target` that tumbles', lambda s: s.target and s.target.kind == TUMBLE)
_WHEELS = Need('`wheels`', lambda s: s.attitude and s.attitude.wheels)
_SENSORS, _TARGET, _CHASER = _section('sensors'), _section('target'), _section('attitude')
_ATTITUDE_SENSORS, _FILTER = _section('attitude_sensors'), _section('attitude_estimator')

_SPREADS = ('uniform', 'normal')
SHELL = 'shell'
"""A vector of any direction, all equally likely, its length between two numbers, all equally
likely. It stands in place of what the scenario has; the others are added to that."""

QUANTITIES = {
    'initial_position_m': Quantity(3, 'm', (*_SPREADS, SHELL), 1e4),
    'initial_velocity_m_s': Quantity(3, 'm/s', (*_SPREADS, SHELL), 1e2),
    'mass_share': _share(0.99, own=False),
    'thrust_share': Quantity(3, '', _SPREADS, 1.0),
    'misalignment_deg': Quantity(3, 'deg', _SPREADS, 90.0),
    'navigation_position_bias_m': Quantity(3, 'm', _SPREADS, 1e4),
    'navigation_velocity_bias_m_s': Quantity(3, 'm/s', _SPREADS, 1e2),
    'disturbance_amplitude_share': _share(1e3, _DISTURBED, own=False),
    'disturbance_phase_rad': _share(10.0, _PERIODIC, 'rad', own=False),
    'disturbance_frequency_share': _share(1e3, _PERIODIC, own=False),
    'orbit_altitude_m': _share(1e8, unit='m', own=False),
    'delay_ticks': Quantity(1, 'ticks', ('whole',), 1000),
    'navigation_position_noise_m': Quantity(1, 'm', ('white',), 1e4),
    'navigation_velocity_noise_m_s': Quantity(1, 'm/s', ('white',), 1e2),
    'density_share': _share(1.0, _DRAG),
    'ballistic_coefficient_share': _share(0.99, _DRAG),
    'true_anomaly_deg': _share(180.0, _ORBIT, 'deg'),
    'stuck_off_thruster': Quantity(1, '', ('whole',), 23, _PULSES, own=True),
    'sensor_noise_share': _share(0.99, _SENSORS),
    'sensor_scale_error': _share(0.99, _SENSORS),
    **_axes('sensor_bias_{}_m', 1e4, _SENSORS, 'm'),
    **_axes('sensor_velocity_bias_{}_m_s', 1e2, _SENSORS, 'm/s'),
    'star_tracker_noise_share': _share(0.99, _ATTITUDE_SENSORS),
    **_axes('gyro_bias_{}_rad_s', 0.1, _ATTITUDE_SENSORS, 'rad/s'),
    **_axes('attitude_error_{}_deg', 60.0, _FILTER, 'deg'),
    'target_rate_share': _share(10.0, _TURNS),
    **_axes('target_attitude_{}_deg', 180.0, _TARGET, 'deg'),
    **_axes('target_rate_{}_deg_s', 100.0, _TUMBLES, 'deg/s'),
    **_axes('target_known_error_{}_deg', 45.0, _TARGET, 'deg'),
    'chaser_inertia_share': _share(0.99, _CHASER),
    **_axes('chaser_attitude_{}_deg', 180.0, _CHASER, 'deg'),
    **_axes('chaser_rate_{}_deg_s', 100.0, _CHASER, 'deg/s'),
    'wheel_torque_share': _share(0.99, _WHEELS),
    **_axes('wheel_start_{}_share', 1.0, _WHEELS, ''),
}
"""What can be dispersed, in the order of the columns of those drawn by themselves. The names
`share` are relative: mass = (1 + share) x the scenario's."""


@dataclass(frozen=True)
class Dispersion:
    """How one quantity deviates from the scenario's.

    distribution : 'uniform', within +- spread; 'normal', spread = 1 sigma, cut at 3 sigma; 'whole',
        0..spread with equal chance; 'white', noise of 1 sigma = spread, new at each tick; 'shell'
    spread : one number per component; of a shell, its smallest and its largest length
    """

    distribution: str
    spread: tuple[float, ...]

    @property
    def extreme(self) -> tuple[float, ...]:
        """Largest deviation of each component."""
        if self.distribution == SHELL:
            return self.spread[1], 0.0, 0.0
        return tuple(s * (CUT if self.distribution == 'normal' else 1.0) for s in self.spread)


def dispersion(name: str, value: Any) -> Dispersion:
    """Return the dispersion of a quantity as a campaign file has it; raises InputError."""
    quantity, place = QUANTITIES[name], f'dispersions.{name}'
    data = mapping(place, value, [], quantity.distributions)
    if len(data) != 1:
        raise InputError(
            f'`{place}` must give one of {", ".join(quantity.distributions)}; got {shown(value)}'
        )
    distribution, spread = next(iter(data.items()))
    place = f'{place}.{distribution}'
    if distribution == 'whole':
        return Dispersion(distribution, (whole(place, spread, least=0, most=int(quantity.most)),))
    if distribution == SHELL:
        return Dispersion(distribution, _lengths(place, spread, quantity))
    most = quantity.most / (CUT if distribution == 'normal' else 1.0)
    if not isinstance(spread, list):
        spread = [spread] * quantity.components
    if len(spread) != quantity.components:
        raise InputError(
            f'`{place}` must be one number or a list of {quantity.components} in '
            f'{quantity.unit or "1"}; got {shown(spread)}'
        )
    return Dispersion(
        distribution, tuple(real(place, s, quantity.unit, least=0.0, most=most) for s in spread)
    )


def _lengths(place: str, value: Any, quantity: Quantity) -> tuple[float, float]:
    """Return the smallest and the largest length of a shell."""
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(
            f'`{place}` must be a list, the smallest and the largest length in {quantity.unit}; '
            f'got {shown(value)}'
        )
    least = real(f'{place}[0]', value[0], quantity.unit, least=0.0, most=quantity.most)
    return least, real(f'{place}[1]', value[1], quantity.unit, least=least, most=quantity.most)
