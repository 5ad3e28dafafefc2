# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What controllers of flights side by side see: errors of navigation, or sensors and filter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_kernels.attitude_kernels import attitude_at, frame_of, to_lvlh
from rpo_kernels.kernels import measured
from rpo_kernels.noise import six_normals
from rpo_montecarlo.engine.lanes import (
    FORCE,
    KNOWN_SPREAD,
    PAIRED_LANES,
    QUAT,
    QUAT_W,
    RUNS,
    SEEN_QUAT,
    SEEN_QUAT_W,
    SEEN_R,
    SEEN_V,
    SPREAD_X,
    SPREAD_Y,
    SPREAD_Z,
    R,
    V,
    compiled,
)
from rpo_montecarlo.engine.parts.target import (
    ATTITUDE,
    BODY,
    DT,
    body_of,
    step_attitudes,
    targets_of,
)
from rpo_montecarlo.engine.parts.target import TURNS as BODY_TURNS
from rpo_montecarlo.engine.tick import (
    ADDED,
    PASSED,
    Batch,
    Draw,
    Kind,
    Part,
    register,
    table_of,
)
from rpo_nav.estimator import Estimator, filter_of, memory_of
from rpo_nav.filter_kernels import FULL, HEADING, PORT, X, estimate, spreads
from rpo_nav.navigation_errors import Navigation
from rpo_nav.sensor_kernels import (
    COLUMNS,
    KEY,
    NOISE,
    PERIOD,
    SENSORS,
    UNITS,
    noise_at,
    noise_of,
    port_at,
    sensed,
)
from rpo_nav.sensors import NOISES, STILL, Sensing, Sensors

Floats = NDArray[np.float64]

NOISE_R, NOISE_V, KEYS = 0, 1, 2
BIAS = KEYS + 2 * RUNS
"""Places in the table of errors: 1 sigma of the noise [m], [m/s]; keys (2, 40); biases (6, 40)."""

SIZES, OPPOSES, TURNS, LOOKS, PLACE, NOISES_OF, TABLES = 0, 4, 5, 6, 7, 10, 10 + 2 * RUNS
"""Places in the table of estimators: sizes of the tables of a run's sensors and filter, and of
their memories; whether commands oppose the disturbance that is estimated; whether a sensor turns
with the chaser: 1, the attitude is the true one, 2, it is estimated; whether one looks at the port,
and its place [m] in the target's axes; keys of the noise (2, 40); those tables, run by run; then
`targets_of` the true targets and the known ones, if one looks there. The memory begins with the
commands of the tick before (120,); it ends with an attitude (16,), the ports (3, 40) and attitudes
(7, 40) of both, and the noise of a sensor (8, 40)."""

_PORTS = PAIRED_LANES + ATTITUDE
"""Numbers of ports and attitudes in the memory, of the true targets or of those that are known."""

NAMES = tuple(f'bias_{axis}' for axis in ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'))
_NOISES = ('navigation_position_noise_m', 'navigation_velocity_noise_m_s')


@compiled
def measure(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN: truth, bias and noise, which the memory has."""
    sigma_r, sigma_v = t[NOISE_R], t[NOISE_V]
    if sigma_r > 0.0 or sigma_v > 0.0:
        for s in range(RUNS):
            x = six_normals(tick, int(t[KEYS + s]), int(t[KEYS + RUNS + s]))
            m[s], m[RUNS + s], m[2 * RUNS + s] = x[0], x[1], x[2]
            m[3 * RUNS + s], m[4 * RUNS + s], m[5 * RUNS + s] = x[3], x[4], x[5]
    for s in range(PAIRED_LANES):
        w[SEEN_R + s] = measured(w[R + s], t[BIAS + s], sigma_r, m[s])
        w[SEEN_V + s] = measured(w[V + s], t[BIAS + PAIRED_LANES + s], sigma_v, m[PAIRED_LANES + s])


@compiled
def _memories(m, t):  # type: ignore[no-untyped-def]
    """Return the places of the memories of sensors and filters, and the size of each."""
    sensors, filters = int(t[SIZES + 2]), int(t[SIZES + 3])
    return PAIRED_LANES, PAIRED_LANES + RUNS * sensors, sensors, filters


@compiled
def _attitude(w, attitude, estimated, s):  # type: ignore[no-untyped-def]
    """Return the true quaternion of a run; fill the attitude (13,) that its filter takes."""
    y, z = s + RUNS, s + 2 * RUNS
    true = (w[QUAT + s], w[QUAT + y], w[QUAT + z], w[QUAT_W + s])
    attitude[0], attitude[1], attitude[2], attitude[3] = true
    if estimated:
        attitude[0], attitude[1] = w[SEEN_QUAT + s], w[SEEN_QUAT + y]
        attitude[2], attitude[3] = w[SEEN_QUAT + z], w[SEEN_QUAT_W + s]
        for i in range(3):
            lane = s + i * RUNS
            attitude[4 + i], attitude[7 + i] = w[SPREAD_X + lane], w[SPREAD_Y + lane]
            attitude[10 + i] = w[SPREAD_Z + lane]
    return true


@compiled
def _draw(m, t, tick):  # type: ignore[no-untyped-def]
    """Put the noise of this tick into the memories of the sensors: in lanes, the same bits."""
    first, size = t[TABLES:], int(t[SIZES + 2])
    noise, place = m[len(m) - NOISE * RUNS :], PAIRED_LANES + noise_at(first)
    for i in range(int(first[SENSORS])):
        if tick % int(first[UNITS + COLUMNS * i + PERIOD]) != 0:
            continue
        for s in range(RUNS):
            drawn = noise_of(tick, i + 1, int(t[NOISES_OF + s]), int(t[NOISES_OF + RUNS + s]))
            for j in range(NOISE):
                noise[j * RUNS + s] = drawn[j]
        for s in range(RUNS):
            for j in range(NOISE):
                m[place + NOISE * i + size * s + j] = noise[j * RUNS + s]


@compiled
def _turn_ports(m, t, tick):  # type: ignore[no-untyped-def]
    """Fill the ports (3, 40) of true and known targets, whose attitudes follow in the memory."""
    port, first = (t[PLACE], t[PLACE + 1], t[PLACE + 2]), t[TABLES:]
    targets = first[(int(t[SIZES]) + int(t[SIZES + 1])) * RUNS :]
    for known in range(2):
        own, table = m[_PORTS * known :], targets[BODY * known :]
        attitudes = own[PAIRED_LANES:]
        if tick > 0:
            step_attitudes(attitudes, table, table[DT])
        for s in range(RUNS):
            f = frame_of(attitude_at(attitudes, s, RUNS), body_of(table, table[BODY_TURNS], s))
            own[s], own[RUNS + s], own[2 * RUNS + s] = to_lvlh(port, f)


@compiled
def navigate(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the estimates."""
    a, b = int(t[SIZES]), int(t[SIZES + 1])
    sensors, filters, c, d = _memories(m, t)
    attitude, true = m[filters + d * RUNS :], (0.0, 0.0, 0.0, 1.0)
    _draw(m, t, tick)
    ports, place = attitude[HEADING:], port_at(t[TABLES:])
    if t[LOOKS] > 0.0:
        _turn_ports(ports, t, tick)
    for s in range(RUNS):
        if t[TURNS] > 0.0:
            true = _attitude(w, attitude, t[TURNS] > 1.0, s)
        y, z, settings = s + RUNS, s + 2 * RUNS, t[TABLES + (a + b) * s :][: a + b]
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        arrived, memory = m[sensors + c * s :][:c], m[filters + d * s :][:d]
        if t[LOOKS] > 0.0:
            for i in range(3):
                arrived[place + i] = ports[s + i * RUNS]
                attitude[PORT + i] = ports[_PORTS + s + i * RUNS]
        sensed(tick, state, true, settings[:a], arrived)
        estimate(tick, (m[s], m[y], m[z]), arrived, attitude, settings[a:], memory)
        w[SEEN_R + s], w[SEEN_R + y], w[SEEN_R + z] = memory[X], memory[X + 1], memory[X + 2]
        w[SEEN_V + s], w[SEEN_V + y], w[SEEN_V + z] = memory[X + 3], memory[X + 4], memory[X + 5]
        w[KNOWN_SPREAD + s], w[KNOWN_SPREAD + y] = spreads(memory)


@compiled
def oppose(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Subtract the disturbances that are estimated from row FORCE, where that is wanted."""
    if t[OPPOSES] == 0.0:
        return
    _, filters, _, d = _memories(m, t)
    for s in range(RUNS):
        for axis in range(3):
            w[FORCE + axis * RUNS + s] -= m[filters + d * s + X + 6 + axis]


@compiled
def remember(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep row FORCE, the commands of this tick, for the next one."""
    for s in range(PAIRED_LANES):
        m[s] = w[FORCE + s]


def errors_part(biases: Floats, noise: tuple[float, ...] = (0.0, 0.0), keys: Any = None) -> Part:
    """Return the part of biases (6, 40), noise [m], [m/s] and its keys (2, 40)."""
    keys = np.zeros((2, RUNS)) if keys is None else keys
    table = table_of(noise, keys, biases)
    return Part('navigation', ((Place.SENSOR, measure),), table, np.zeros(6 * RUNS))


def _errors(batch: Batch) -> Part | None:
    if batch.base.section(Estimator) is not None:
        return None
    noise = tuple(batch.dispersed.get(name, (0.0,))[0] for name in _NOISES)
    return errors_part(batch.columns(*NAMES), noise, batch.key_rows)


def vary_errors(scenario: Scenario, draw: Draw) -> list[Any]:
    """Return the errors of navigation of a run."""
    if not any(name.startswith('navigation_') for name in draw.dispersed):
        return []
    x, y, z, vx, vy, vz = (draw.values[name] for name in NAMES)
    noise_r, noise_v = (draw.dispersed.get(name, (0.0,))[0] for name in _NOISES)
    return [Navigation((x, y, z), (vx, vy, vz), noise_r, noise_v, draw.key)]


def estimators_of(batch: Batch) -> Part | None:
    """Return the sensors and filters of runs; None where there is no estimator."""
    if batch.base.section(Estimator) is None:
        return None
    sensing, filters = [], []
    for s in batch.scenarios:
        sensors, settings = s.section(Sensors), s.section(Estimator)
        assert sensors is not None and settings is not None
        sensing.append(Sensing(sensors, s))
        filters.append(np.asarray(filter_of(settings, sensors, s)))
        filters[-1][FULL] = float(getattr(batch.base.named('assurance'), 'sigmas', 0.0) > 0.0)
    memories = [np.asarray(memory_of(f)) for f in filters]
    longest = max(map(len, memories))
    memories = [np.pad(m, (0, longest - len(m))) for m in memories]
    tables = [table_of(s.table, f) for s, f in zip(sensing, filters, strict=True)]
    keys = [s.table[KEY : KEY + 2] for s in sensing]
    sizes = [len(v) for v in (sensing[0].table, filters[0], sensing[0].memory, memories[0])]
    sensors = batch.base.section(Sensors)
    assert sensors is not None
    true = [s.target or STILL for s in batch.scenarios] if sensors.look else []
    both = [
        targets_of(batch, some, [0] * len(some)) for some in (true, [t.known for t in true]) if some
    ]
    return Part(
        'estimator',
        ((Place.ESTIMATOR, navigate), (ADDED + 1, oppose), (PASSED, remember)),
        table_of(
            *(sizes, batch.base.compensated, _turning(batch.base), sensors.look, sensors.port_m),
            *(batch.lanes(keys), batch.lanes(tables).T, *(numbers for numbers, _ in both)),
        ),
        table_of(
            np.zeros(PAIRED_LANES),
            batch.lanes([s.memory for s in sensing]).T,
            batch.lanes(memories).T,
            np.zeros(HEADING),
            *(table_of(np.zeros(PAIRED_LANES), attitudes) for _, attitudes in both),
            np.zeros(NOISE * RUNS),
        ),
    )


def _turning(base: Scenario) -> int:
    """Return 1 where a sensor turns with the chaser, 2 where its attitude is estimated."""
    sensors = base.section(Sensors)
    if sensors is None or not sensors.turn:
        return 0
    return 1 if base.named('attitude_estimator') is None else 2


def vary_sensors(scenario: Scenario, draw: Draw) -> list[Any]:
    """Return sensors and estimator of a run; the filter assumes what is nominal."""
    sensors, estimator = scenario.section(Sensors), scenario.section(Estimator)
    if sensors is None:
        return []
    louder = 1.0 + draw.values.get('sensor_noise_share', 0.0)
    bias = [draw.values.get(f'sensor_bias_{axis}_m', 0.0) for axis in 'xyz']
    drift = [draw.values.get(f'sensor_velocity_bias_{axis}_m_s', 0.0) for axis in 'xyz']
    units = []
    for unit in sensors.units:
        changed: dict[str, Any] = {name: getattr(unit, name) * louder for name in NOISES}
        changed['scale_error'] = unit.scale_error + draw.values.get('sensor_scale_error', 0.0)
        changed['bias_m'] = tuple(b + more for b, more in zip(unit.bias_m, bias, strict=True))
        if unit.velocity_floor_m_s > 0.0:
            pairs = zip(unit.velocity_bias_m_s, drift, strict=True)
            changed['velocity_bias_m_s'] = tuple(b + more for b, more in pairs)
        units.append(replace(unit, **changed))
    found: list[Any] = [replace(sensors, units=tuple(units), noise_key=draw.key)]
    if estimator is not None:
        assumed = replace(
            estimator,
            noise_scale=estimator.noise_scale / louder,
            mass_kg=estimator.mass_kg or scenario.mass_kg,
            delay_ticks=getattr(scenario.thrusters, 'delay_ticks', 0)
            if estimator.delay_ticks < 0
            else estimator.delay_ticks,
        )
        found.append(assumed)
    return found


register(Kind('', _errors, vary=vary_errors))
register(Kind('sensors', lambda batch: None, vary=vary_sensors))
register(Kind('estimator', estimators_of))
