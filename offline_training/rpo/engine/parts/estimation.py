# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What controllers of flights side by side see: errors of navigation, or sensors and filter."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo.engine.lanes import (
    FORCE,
    FOUND_PUSH,
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
from rpo.engine.parts import estimation_tables as tables
from rpo.engine.parts.attitude import vector_in
from rpo.engine.parts.estimation_tables import (
    HEADING,
    PORT,
    X,
    estimate,
    filter_of,
    memory_of,
    spreads,
)
from rpo.engine.parts.sensor_tables import (
    COLUMNS,
    DROPOUT,
    HAS_VELOCITY,
    KEY,
    NOISE,
    OUTLIER,
    PERIOD,
    SENSORS,
    Sensing,
    noise_at,
    noise_of,
    port_at,
    sensed,
)
from rpo.engine.parts.target import ATTITUDE, BODY, DT, TURNS, body_of, step_attitudes, targets_of
from rpo.engine.tick import ADDED, PASSED, Batch, Kind, Part, register, table_of
from rpo_core.attitude.attitude_kernels import attitude_at, frame_of, to_lvlh
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.noise import six_normals
from rpo_core.kernels.vectors import OWN, WIDTH, over_runs, own_tables
from rpo_core.navigation.estimator import Estimator
from rpo_core.navigation.sensors import STILL, Sensors, measured
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place

NOISE_R, NOISE_V, KEYS = 0, 1, 2
BIAS = KEYS + 2 * RUNS
"""Places in the table of errors: 1 sigma of the noise [m], [m/s]; keys (2, 40); biases (6, 40)."""

OPPOSES, COUNT, LOOKS, PLACE, PERIODS = OWN, OWN + 1, OWN + 2, OWN + 3, OWN + 6
NOISES_OF = PERIODS + tables.MOST_SENSORS
TARGETS = NOISES_OF + 2 * RUNS
_PORTS = PAIRED_LANES + ATTITUDE
COMMANDS, PORTS = 0, PAIRED_LANES
DRAWN = PORTS + 2 * _PORTS
"""Places in the table of estimators: whether commands oppose the disturbance that is estimated; how
many sensors; whether one looks at the port, and its place [m] in the target's axes; the period
[ticks] of each sensor; keys of the noise (2, 40); `targets_of` the true targets and the known ones,
if a sensor looks there. In the memory: commands of the tick before (120,), the ports (3, 40) and
attitudes (7, 40) of those targets, noise of each sensor (8, 40).

A run's own table has the sizes of the table and memory of its sensors; whether one turns with the
chaser: 1, the attitude is the true one, 2, it is estimated; whether one looks at the port; the
table of its sensors, that of its filter. Its own memory has an attitude (16,), then that of its
sensors, that of its filter."""

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
def _attitude(w, attitude, estimated, s):  # type: ignore[no-untyped-def]
    """Return the true quaternion of a run; fill the attitude (13,) that its filter takes."""
    y, z = s + RUNS, s + 2 * RUNS
    true = (w[QUAT + s], w[QUAT + y], w[QUAT + z], w[QUAT_W + s])
    attitude[0], attitude[1], attitude[2], attitude[3] = true
    if estimated:
        attitude[3] = w[SEEN_QUAT_W + s]
        for i in range(3):
            lane = s + i * RUNS
            attitude[i], attitude[4 + i] = w[SEEN_QUAT + lane], w[SPREAD_X + lane]
            attitude[7 + i], attitude[10 + i] = w[SPREAD_Y + lane], w[SPREAD_Z + lane]
    return true


@compiled
def _turn_ports(m, t, tick):  # type: ignore[no-untyped-def]
    """Fill the ports (3, 40) of true and known targets, whose attitudes follow in the memory."""
    port = (t[PLACE], t[PLACE + 1], t[PLACE + 2])
    for known in range(2):
        own, table = m[PORTS + _PORTS * known :], t[TARGETS + BODY * known :]
        attitudes = own[PAIRED_LANES:]
        if tick > 0:
            step_attitudes(attitudes, table, table[DT])
        for s in range(RUNS):
            f = frame_of(attitude_at(attitudes, s, RUNS), body_of(table, table[TURNS], s))
            own[s], own[RUNS + s], own[2 * RUNS + s] = to_lvlh(port, f)


@compiled
def _estimate(tick, w, m, s, settings, memory):  # type: ignore[no-untyped-def]
    a, c, true = 4 + int(settings[0]), HEADING + int(settings[1]), (0.0, 0.0, 0.0, 1.0)
    if settings[2] > 0.0:
        true = _attitude(w, memory, settings[2] > 1.0, s)
    sensors, arrived, f = settings[4:a], memory[HEADING:c], memory[c:]
    for j in range(NOISE * int(sensors[SENSORS])):
        arrived[noise_at(sensors) + j] = m[DRAWN + j * RUNS + s]
    for i in range(3 if settings[3] > 0.0 else 0):
        lane = PORTS + i * RUNS + s
        arrived[port_at(sensors) + i], memory[PORT + i] = m[lane], m[lane + _PORTS]
    sensed(tick, vector_in(w, R, s) + vector_in(w, V, s), true, sensors, arrived)
    estimate(tick, vector_in(m, COMMANDS, s), arrived, memory, settings[a:], f)
    for i in range(3):
        lane = s + i * RUNS
        w[SEEN_R + lane], w[SEEN_V + lane] = f[X + i], f[X + 3 + i]
        w[FOUND_PUSH + lane] = f[X + 6 + i]
    w[KNOWN_SPREAD + s], w[KNOWN_SPREAD + RUNS + s] = spreads(f)


_estimate_all = over_runs(_estimate, RUNS)


@compiled
def navigate(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the estimates."""
    for i in range(int(t[COUNT])):
        if tick % int(t[PERIODS + i]) != 0:
            continue
        noise = m[DRAWN + i * NOISE * RUNS :]
        for s in range(RUNS):
            drawn = noise_of(tick, i + 1, int(t[NOISES_OF + s]), int(t[NOISES_OF + RUNS + s]))
            for j in range(NOISE):
                noise[j * RUNS + s] = drawn[j]
    if t[LOOKS] > 0.0:
        _turn_ports(m, t, tick)
    _estimate_all(w, m, t, tick)


@compiled
def oppose(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Subtract the disturbances that are estimated from row FORCE, where that is wanted."""
    if t[OPPOSES] > 0.0:
        for s in range(PAIRED_LANES):
            w[FORCE + s] -= w[FOUND_PUSH + s]


@compiled
def remember(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep row FORCE, the commands of this tick, for the next one."""
    for s in range(PAIRED_LANES):
        m[COMMANDS + s] = w[FORCE + s]


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


def estimators_of(batch: Batch) -> Part | None:
    """Return the sensors and filters of runs; None where there is no estimator."""
    base, nominal = batch.base, batch.base.section(Sensors)
    if base.section(Estimator) is None or nominal is None:
        return None
    keys, filters, memories, true = [], [], [], []
    for s in batch.scenarios:
        sensors, settings = s.section(Sensors), s.section(Estimator)
        assert sensors is not None and settings is not None
        sensing, f = Sensing(sensors, s), np.asarray(filter_of(settings, sensors, s))
        f[tables.FULL] = float(getattr(base.named('assurance'), 'sigmas', 0.0) > 0.0)
        head = len(sensing.table), len(sensing.memory), _turning(base), nominal.look
        keys.append(sensing.table[KEY : KEY + 2])
        filters.append(table_of(head, sensing.table, f))
        memories.append(table_of(np.zeros(HEADING), sensing.memory, memory_of(f)))
        true.append(s.target or STILL)
    both = [targets_of(batch, some, [0] * len(some)) for some in (true, [t.known for t in true])]
    ports = [table_of(np.zeros(PAIRED_LANES), attitudes) for _, attitudes in both]
    units = np.zeros((tables.MOST_SENSORS, COLUMNS))
    units[: len(sensing.rows)] = sensing.rows
    # noise of velocity, losses and outliers are branches that runs take alone
    together = not units[:, [HAS_VELOCITY, DROPOUT, OUTLIER]].any()
    owned = own_tables(
        WIDTH if together else 1,
        table_of(
            *(base.compensated, len(sensing.rows), nominal.look, nominal.port_m, units[:, PERIOD]),
            *(batch.lanes(keys), *(numbers for numbers, _ in both)),
        ),
        batch.lanes(filters),
        table_of(np.zeros(PORTS), *ports, np.zeros(len(sensing.rows) * NOISE * RUNS)),
        batch.lanes(memories),
        HEADING + len(sensing.memory),
        tables.SCRATCH,
    )
    steps = ((Place.ESTIMATOR, navigate), (ADDED + 1, oppose), (PASSED, remember))
    return Part('estimator', steps, *owned)


def _turning(base: Scenario) -> int:
    """Return 1 where a sensor turns with the chaser, 2 where its attitude is estimated."""
    sensors = base.section(Sensors)
    if sensors is None or not sensors.turn:
        return 0
    return 1 if base.named('attitude_estimator') is None else 2


register(Kind('', _errors))
register(Kind('sensors', lambda batch: None))
register(Kind('estimator', estimators_of))
