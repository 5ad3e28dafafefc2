# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a campaign can disperse, and how far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from rpo_core.files.validation import InputError, mapping, real, shown, whole

CUT = 3.0
"""Normal dispersions are cut at so many standard deviations."""


class Quantity(NamedTuple):
    """A quantity that can be dispersed; most : largest deviation that is accepted."""

    components: int
    unit: str
    distributions: tuple[str, ...]
    most: float


_SPREADS = ('uniform', 'normal')
SHELL = 'shell'
"""A vector of any direction, all equally likely, its length between two numbers, all equally
likely. It stands in place of what the scenario has; the others are added to that."""

QUANTITIES = {
    'initial_position_m': Quantity(3, 'm', (*_SPREADS, SHELL), 1e4),
    'initial_velocity_m_s': Quantity(3, 'm/s', (*_SPREADS, SHELL), 1e2),
    'mass_share': Quantity(1, '', _SPREADS, 0.99),
    'thrust_share': Quantity(3, '', _SPREADS, 1.0),
    'misalignment_deg': Quantity(3, 'deg', _SPREADS, 90.0),
    'navigation_position_bias_m': Quantity(3, 'm', _SPREADS, 1e4),
    'navigation_velocity_bias_m_s': Quantity(3, 'm/s', _SPREADS, 1e2),
    'disturbance_amplitude_share': Quantity(1, '', _SPREADS, 1e3),
    'disturbance_phase_rad': Quantity(1, 'rad', _SPREADS, 10.0),
    'disturbance_frequency_share': Quantity(1, '', _SPREADS, 1e3),
    'orbit_altitude_m': Quantity(1, 'm', _SPREADS, 1e8),
    'delay_ticks': Quantity(1, 'ticks', ('whole',), 1000),
    'navigation_position_noise_m': Quantity(1, 'm', ('white',), 1e4),
    'navigation_velocity_noise_m_s': Quantity(1, 'm/s', ('white',), 1e2),
    'density_share': Quantity(1, '', _SPREADS, 1.0),
    'ballistic_coefficient_share': Quantity(1, '', _SPREADS, 0.99),
    'true_anomaly_deg': Quantity(1, 'deg', _SPREADS, 180.0),
    'stuck_off_thruster': Quantity(1, '', ('whole',), 23),
    'sensor_noise_share': Quantity(1, '', _SPREADS, 0.99),
    'sensor_scale_error': Quantity(1, '', _SPREADS, 0.99),
    **{f'sensor_bias_{axis}_m': Quantity(1, 'm', _SPREADS, 1e4) for axis in 'xyz'},
    'target_rate_share': Quantity(1, '', _SPREADS, 10.0),
    **{f'target_attitude_{axis}_deg': Quantity(1, 'deg', _SPREADS, 180.0) for axis in 'xyz'},
    **{f'target_rate_{axis}_deg_s': Quantity(1, 'deg/s', _SPREADS, 100.0) for axis in 'xyz'},
    **{f'target_known_error_{axis}_deg': Quantity(1, 'deg', _SPREADS, 45.0) for axis in 'xyz'},
    'star_tracker_noise_share': Quantity(1, '', _SPREADS, 0.99),
    **{f'gyro_bias_{axis}_rad_s': Quantity(1, 'rad/s', _SPREADS, 0.1) for axis in 'xyz'},
    **{f'attitude_error_{axis}_deg': Quantity(1, 'deg', _SPREADS, 60.0) for axis in 'xyz'},
    'chaser_inertia_share': Quantity(1, '', _SPREADS, 0.99),
    **{f'chaser_attitude_{axis}_deg': Quantity(1, 'deg', _SPREADS, 180.0) for axis in 'xyz'},
    **{f'chaser_rate_{axis}_deg_s': Quantity(1, 'deg/s', _SPREADS, 100.0) for axis in 'xyz'},
    'wheel_torque_share': Quantity(1, '', _SPREADS, 0.99),
    **{f'wheel_start_{axis}_share': Quantity(1, '', _SPREADS, 1.0) for axis in 'xyz'},
    **{f'sensor_velocity_bias_{axis}_m_s': Quantity(1, 'm/s', _SPREADS, 1e2) for axis in 'xyz'},
}
"""What can be dispersed. The names `share` are relative: mass = (1 + share) x the scenario's."""


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
