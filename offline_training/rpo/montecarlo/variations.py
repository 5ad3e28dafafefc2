# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a drawn run changes of the sections of its scenario: one function a section.

Those of users' sections are registered by their modules (`register`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from math import degrees, radians
from operator import add
from typing import Any, NamedTuple

from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.target import TUMBLE, of_vector, product, unit
from rpo_core.control.attitude import AttitudeControl
from rpo_core.files.validation import InputError
from rpo_core.guidance.guidance import Guidance
from rpo_core.kernels.arithmetic import Vector
from rpo_core.navigation.attitude_estimator import AttitudeEstimator
from rpo_core.navigation.attitude_sensors import AttitudeSensors
from rpo_core.navigation.estimator import Estimator
from rpo_core.navigation.sensors import NOISES, Navigation, Sensors
from rpo_core.scenario.scenario import Scenario
from rpo_core.thrusters.table import Failure
from rpo_core.thrusters.thrusters import Thrusters, rotation

_BIASES = tuple(f'bias_{axis}' for axis in ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'))
_NOISES = ('navigation_position_noise_m', 'navigation_velocity_noise_m_s')


class Draw(NamedTuple):
    """What was drawn of one run of a campaign.

    values : name -> value (`rpo.montecarlo.sampling.PARAMETERS`)
    dispersed : name -> spread of all that the campaign disperses
    key : two words of 32 bits
    """

    values: Mapping[str, float]
    dispersed: Mapping[str, tuple[float, ...]]
    key: tuple[int, int]

    def vector(self, name: str) -> Vector:
        """Return what was drawn of a quantity for each axis; `{}` in the name: x, y, z."""
        x, y, z = (self.values.get(name.format(axis), 0.0) for axis in 'xyz')
        return x, y, z

    def added(self, value: Vector, name: str) -> Vector:
        """Return a vector of a scenario with what was drawn of it."""
        x, y, z = map(add, value, self.vector(name))
        return x, y, z


Variation = Callable[[Scenario, Draw], Any]
"""From the scenario of a campaign and a draw to the settings of a section in the run; None: as in
the scenario."""

VARIATIONS: dict[str, Variation] = {}
"""Section -> what draws change of it."""


def register(section: str) -> Callable[[Variation], Variation]:
    """Let campaigns vary a section; raises InputError if it is varied already."""

    def add_it(variation: Variation) -> Variation:
        if section in VARIATIONS:
            raise InputError(f'section `{section}` must be varied by one function; it is already')
        VARIATIONS[section] = variation
        return variation

    return add_it


def sections_of(scenario: Scenario, draw: Draw) -> Iterable[Any]:
    """Return the sections of a run."""
    varied = (variation(scenario, draw) for variation in VARIATIONS.values())
    return scenario.sections_with(*(settings for settings in varied if settings is not None))


def _assuming_mass(scenario: Scenario, settings: Any, draw: Draw) -> Any:
    """Return settings that assume the nominal mass."""
    if settings is None or 'mass_share' not in draw.dispersed:
        return None
    return replace(settings, mass_kg=settings.mass_kg or scenario.mass_kg)


@register('guidance')
def guidance(scenario: Scenario, draw: Draw) -> Any:
    """Return guidance, which assumes the nominal mass."""
    return _assuming_mass(scenario, scenario.section(Guidance), draw)


@register('assurance')
def assurance(scenario: Scenario, draw: Draw) -> Any:
    """Return assurance, which assumes the nominal mass."""
    return _assuming_mass(scenario, scenario.section(Assurance), draw)


@register('attitude')
def attitude(scenario: Scenario, draw: Draw) -> Any:
    """Return the chaser: its inertia, attitude and rates at the start, its wheels."""
    chaser = scenario.attitude
    if chaser is None:
        return None
    x, y, z = map(radians, draw.vector('chaser_attitude_{}_deg'))
    share = 1.0 + draw.values.get('chaser_inertia_share', 0.0)
    varied = replace(
        chaser,
        inertia_kg_m2=tuple(tuple(share * j for j in row) for row in chaser.inertia_kg_m2),
        attitude=unit(product(chaser.attitude, of_vector((x, y, z)))),
    )
    rates = draw.vector('chaser_rate_{}_deg_s')
    if any(rates):
        begun = map(degrees, varied.start(scenario.mean_motion_rad_s)[4:])
        varied = replace(varied, rates_deg_s=tuple(map(add, begun, rates)))
    if chaser.wheels is None:
        return varied
    momentum_nms, starts = chaser.wheels.momentum_nms, draw.vector('wheel_start_{}_share')
    pairs = zip(chaser.wheels.start_nms, starts, strict=True)
    wheels = replace(
        chaser.wheels,
        torque_nm=chaser.wheels.torque_nm * (1.0 + draw.values.get('wheel_torque_share', 0.0)),
        start_nms=tuple(start + share * (momentum_nms - abs(start)) for start, share in pairs),
    )
    return replace(varied, wheels=wheels)


@register('attitude_control')
def attitude_control(scenario: Scenario, draw: Draw) -> Any:
    """Return the controller of the attitude: it assumes the inertia of the campaign's chaser."""
    settings = scenario.section(AttitudeControl)
    if settings is None or settings.inertia_kg_m2 is not None:
        return None
    return replace(settings, inertia_kg_m2=scenario.named('attitude').inertia_kg_m2)


@register('attitude_sensors')
def attitude_sensors(scenario: Scenario, draw: Draw) -> Any:
    """Return the sensors of the attitude."""
    sensors = scenario.section(AttitudeSensors)
    if sensors is None:
        return None
    star, gyro, louder = sensors.star_tracker, sensors.gyro, _louder(draw, 'star_tracker')
    return replace(
        sensors,
        star_tracker=replace(
            star,
            cross_noise_arcsec=louder * star.cross_noise_arcsec,
            boresight_noise_arcsec=louder * star.boresight_noise_arcsec,
        ),
        gyro=replace(gyro, bias_rad_s=draw.added(gyro.bias_rad_s, 'gyro_bias_{}_rad_s')),
        noise_key=draw.key,
    )


def _louder(draw: Draw, sensor: str) -> float:
    """Return the factor of the noise of a sensor."""
    return 1.0 + draw.values.get(f'{sensor}_noise_share', 0.0)


@register('attitude_estimator')
def attitude_estimator(scenario: Scenario, draw: Draw) -> Any:
    """Return the estimator of the attitude, which assumes the nominal noise."""
    estimator = scenario.section(AttitudeEstimator)
    if estimator is None:
        return None
    error = draw.added(estimator.start_error_deg, 'attitude_error_{}_deg')
    scale = estimator.noise_scale / _louder(draw, 'star_tracker')
    return replace(estimator, noise_scale=scale, start_error_deg=error)


@register('dynamics')
def dynamics(scenario: Scenario, draw: Draw) -> Any:
    """Return the dynamics; the atmosphere does not rise with the orbit of a run."""
    nominal, values = scenario.dynamics, draw.values
    if nominal is None:
        return None
    drag = nominal.drag
    if drag is not None:
        lighter = 1.0 + values.get('ballistic_coefficient_share', 0.0)
        drag = replace(
            drag,
            density_kg_m3=drag.density_kg_m3 * (1.0 + values.get('density_share', 0.0)),
            density_radius_m=drag.density_radius_m or scenario.orbit_radius_m,
            chaser_ballistic_coefficient_kg_m2=drag.chaser_ballistic_coefficient_kg_m2 * lighter,
        )
    anomaly_deg = nominal.true_anomaly_deg + values.get('true_anomaly_deg', 0.0)
    return replace(nominal, true_anomaly_deg=anomaly_deg, drag=drag)


@register('navigation')
def navigation(scenario: Scenario, draw: Draw) -> Any:
    """Return the errors of navigation."""
    if not any(name.startswith('navigation_') for name in draw.dispersed):
        return None
    x, y, z, vx, vy, vz = (draw.values[name] for name in _BIASES)
    noise_r, noise_v = (draw.dispersed.get(name, (0.0,))[0] for name in _NOISES)
    return Navigation((x, y, z), (vx, vy, vz), noise_r, noise_v, draw.key)


@register('sensors')
def sensors(scenario: Scenario, draw: Draw) -> Any:
    """Return the sensors."""
    nominal = scenario.section(Sensors)
    if nominal is None:
        return None
    louder, units = _louder(draw, 'sensor'), []
    for sensor in nominal.units:
        changed: dict[str, Any] = {name: getattr(sensor, name) * louder for name in NOISES}
        changed['scale_error'] = sensor.scale_error + draw.values.get('sensor_scale_error', 0.0)
        changed['bias_m'] = draw.added(sensor.bias_m, 'sensor_bias_{}_m')
        if sensor.velocity_floor_m_s > 0.0:
            bias = draw.added(sensor.velocity_bias_m_s, 'sensor_velocity_bias_{}_m_s')
            changed['velocity_bias_m_s'] = bias
        units.append(replace(sensor, **changed))
    return replace(nominal, units=tuple(units), noise_key=draw.key)


@register('estimator')
def estimator(scenario: Scenario, draw: Draw) -> Any:
    """Return the estimator, which assumes what is nominal."""
    nominal = scenario.section(Estimator)
    if nominal is None or scenario.section(Sensors) is None:
        return None
    delay_ticks = nominal.delay_ticks
    if delay_ticks < 0:
        delay_ticks = getattr(scenario.thrusters, 'delay_ticks', 0)
    return replace(
        nominal,
        noise_scale=nominal.noise_scale / _louder(draw, 'sensor'),
        mass_kg=nominal.mass_kg or scenario.mass_kg,
        delay_ticks=delay_ticks,
    )


@register('target')
def target(scenario: Scenario, draw: Draw) -> Any:
    """Return the target: its attitude turned about its axes, its rates, what is known."""
    nominal = scenario.target
    if nominal is None:
        return None
    x, y, z = map(radians, draw.vector('target_attitude_{}_deg'))
    varied: dict[str, Any] = {'attitude': unit(product(nominal.attitude, of_vector((x, y, z))))}
    share = 1.0 + draw.values.get('target_rate_share', 0.0)
    if nominal.kind == TUMBLE:
        rates = zip(nominal.rates_deg_s, draw.vector('target_rate_{}_deg_s'), strict=True)
        varied['rates_deg_s'] = tuple(share * rate + more for rate, more in rates)
    else:
        varied['rate_deg_s'] = share * nominal.rate_deg_s
    varied['known_error_deg'] = draw.added(nominal.known_error_deg, 'target_known_error_{}_deg')
    return replace(nominal, **varied)


def thrust_matrix(values: Mapping[str, float]) -> tuple[Vector, Vector, Vector]:
    """Return the matrix (3, 3) from saturated to applied force: shares, then misalignment."""
    x, y, z = (1.0 + values[f'thrust_share_{axis}'] for axis in 'xyz')
    a, b, c = (values[f'misalignment_{axis}_rad'] for axis in 'xyz')
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation((a, b, c))
    return (xx * x, xy * y, xz * z), (yx * x, yy * y, yz * z), (zx * x, zy * y, zz * z)


@register('thrusters')
def thrusters(scenario: Scenario, draw: Draw) -> Any:
    """Return the thrusters: the scenario's, and what is dispersed of them."""
    nominal, values = scenario.thrusters, draw.values
    names = {'thrust_share', 'misalignment_deg', 'delay_ticks'}
    if nominal is None and not names & set(draw.dispersed):
        return None
    changes = thrust_matrix(values), int(values['delay_ticks'])
    if nominal is None:
        return Thrusters(*changes)
    varied = replace(nominal, matrix=changes[0], delay_ticks=changes[1])
    part = varied.pulses or varied.table
    if part is not None and 'stuck_off_thruster' in values:
        name = varied.names[int(values['stuck_off_thruster'])]
        known = varied.table is not None and varied.table.finds_failures
        part = replace(
            part, failures=(*part.failures, Failure(thruster=name, stuck='off', known=known))
        )
        varied = replace(varied, **{'table' if varied.table else 'pulses': part})
    return varied
