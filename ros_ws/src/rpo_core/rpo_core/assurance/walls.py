# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The corridor's numbers of the filter: walls that stand in LVLH, and walls that turn.

docs/safety.md, lemmas 4 and 5.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rpo_core.assurance.assumed import SQRT_3, Errors, limit_n, unknown_n
from rpo_core.assurance.kernels import Guard, authority, speed_limit
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.attitude.target import FIXED, known_motion
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import Vector, norm

LATERAL_1_S = 0.02
"""Growth of the lateral speed that is allowed in the corridor, per metre to the port."""

NO_CORRIDOR = {
    'axis': 0, 'side': 0.0, 'port_m': 0.0, 'outer_m': 0.0, 'width_m': 0.0, 'slope': 0.0,
    'contact_m_s': 0.0, 'lateral_m_s': 0.0, 'lateral_1_s': 0.0, 'wall_m_s2': 1.0,
    'doubt_m_s2': 0.0,
}  # fmt: skip

SHARES = (0.5, 0.7, 0.85)
"""Share of what the walls leave of an axis that stays for stopping before them; the rest is for
what the speed in turning axes takes. The first with which there is room."""

_HALVINGS = 24

SQRT_2 = math.sqrt(2.0)


def standing(
    way: Passage,
    scenario: Any,
    errors: Errors,
    here: tuple[float, float],
    following: tuple[float, float],
    settings: Assurance,
) -> dict[str, Any]:
    """Return the corridor's part of the numbers where its walls stand in LVLH."""
    n, dt, mass = scenario.mean_motion_rad_s, scenario.dt_s, errors.mass_kg
    speed = settings.speed
    top = speed.speed_m_s + speed.slope(n) * way.outer_m
    top += math.sqrt(2.0 * speed.deceleration_m_s2 * way.outer_m)
    doubt = unknown_n(errors, scenario) / mass + 3.0 * n * n * way.outer_m + 2.0 * n * top
    slope = way.slope
    per_axis = limit_n(scenario) / mass
    wall = per_axis - (1.0 + slope) * doubt
    dip = (1.0 + slope) * (per_axis + doubt) * dt * dt / 8.0
    found = _Walls(way.port_m, way.width_m, slope, way.closing_m_s, way.lateral_m_s)
    return found.numbers(way, wall, (1.0 + slope) * doubt, dip, top, here, following, dt)


class _Walls(NamedTuple):
    """A corridor: place and half-width of its port, slope of its walls, speeds of contact."""

    port_m: float
    width_m: float
    slope: float
    closing_m_s: float
    lateral_m_s: float

    def numbers(
        self,
        way: Passage,
        wall: float,
        doubt: float,
        dip: float,
        top: float,
        here: tuple[float, float],
        following: tuple[float, float],
        dt: float,
    ) -> dict[str, Any]:
        """Return the corridor's part of the numbers; raises InputError where there is no room.

        wall, doubt : authority per axis, and what it may be off [m/s^2]
        dip : how far a path comes nearer to a wall between two ticks [m]
        top : largest speed [m/s]
        """
        far, width, slope = way.outer_m - self.port_m, self.width_m - dip, self.slope
        wide = following[0] * (1.0 + slope) + 2.0 * dip
        square = self.closing_m_s * self.closing_m_s
        fastest = min(math.sqrt(square + 2.0 * max(wall, 0.0) * far), top)
        for ahead_m, closing in ((0.0, self.closing_m_s), (far, fastest)):
            # Both walls come nearer by so much: between them it takes twice the way to stop.
            narrow = slope * (closing + following[1]) + 2.0 * following[1]
            room, half = wide + narrow * narrow / max(wall, 1e-9), width + slope * ahead_m
            if wall <= 0.0 or room >= half:
                raise InputError(
                    f'`assurance.corridor` and the assumed errors exclude each other: '
                    f'{ahead_m:.6g} m before the port, to stop between the walls takes '
                    f'{room:.6g} m to each side, and `width_m` and `half_angle_deg` leave '
                    f'{half:.6g} m'
                )
        rest = here[1] + doubt * dt
        follows = slope * self.closing_m_s + 2.0 * (1.0 + slope) * here[1] + 2.0 * doubt * dt
        self._check_contact(rest, max(rest, follows))
        return {
            'axis': 'xyz'.index(way.along[1]),
            'side': 1.0 if way.along[0] == '+' else -1.0,
            'port_m': self.port_m,
            'outer_m': way.outer_m,
            'width_m': width,
            'slope': slope,
            'contact_m_s': self.closing_m_s,
            'lateral_m_s': self.lateral_m_s,
            'lateral_1_s': min(LATERAL_1_S, wall / top),
            'wall_m_s2': wall,
            'doubt_m_s2': doubt,
        }

    def _check_contact(self, rest_m_s: float, across_m_s: float) -> None:
        """Refuse speeds of contact that the backup law does not keep for certain.

        rest_m_s : what it leaves where it stops; across_m_s : that, or away from a wall at the port
        """
        if self.closing_m_s < rest_m_s or self.lateral_m_s < across_m_s:
            raise InputError(
                f'`assurance.corridor` and the assumed errors exclude each other: at the port, '
                f'{rest_m_s:.6g} m/s closing and {across_m_s:.6g} m/s across are kept for certain; '
                f'got {self.closing_m_s!r} and {self.lateral_m_s!r}'
            )


class Swing(NamedTuple):
    """Bounds of how the target turns against LVLH, in its axes, at all times of a flight.

    rate_rad_s, change_rad_s2 : (3,) of the rate, and of its change
    spread : a cube of the target's axes is in the thrusters' box if it is so much smaller
    """

    rate_rad_s: Vector
    change_rad_s2: Vector
    spread: float

    def times(self, share: float) -> Swing:
        """Return the bounds where it turns at a share of the rate."""
        (x, y, z), (u, v, w) = self.rate_rad_s, self.change_rad_s2
        k, square = share, share * share
        return Swing((k * x, k * y, k * z), (square * u, square * v, square * w), self.spread)

    def about(self, axis: int) -> Swing:
        """Return the bounds with an axis first; the two others follow in their order."""
        i, j, k = axis, (axis + 1) % 3, (axis + 2) % 3
        r, d = self.rate_rad_s, self.change_rad_s2
        return Swing((r[i], r[j], r[k]), (d[i], d[j], d[k]), self.spread)


def swing_of(scenario: Any) -> Swing:
    """Return the bounds for a flight, as its target's motion is known."""
    motion, target = known_motion(scenario), scenario.target
    assert motion is not None
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    x, y, z, u, v, w, spread = motion.largest(scenario.ticks + delay + 2).tolist()
    # Between the ticks by the derivatives: of a free body, the rate changes by less than its
    # square, its change by twice its cube.
    fastest = target.fastest_rad_s + scenario.mean_motion_rad_s if target.kind != FIXED else 0.0
    off = 0.5 * scenario.dt_s * fastest * fastest
    more = 2.0 * fastest * off
    # Where the thrusters turn with the chaser, a cube has the same room in all axes: in a ball.
    spread = spread if scenario.attitude is None else 1.0
    return Swing((x + off, y + off, z + off), (u + more, v + more, w + more), spread)


def turning(guard: Guard, settings: Assurance, scenario: Any, errors: Errors) -> Guard:
    """Return the numbers of the corridor in the axes of a target that turns: lemma 5.

    Raises InputError where there is none, with the rate at which there would be.
    """
    swing = swing_of(scenario)

    def at(share: float) -> tuple[Guard | None, str]:
        """Return the numbers at a share of the rate, or why there are none."""
        why = ''
        for left in SHARES:
            try:
                return _turning(guard, settings, scenario, errors, swing.times(share), left), ''
            except InputError as error:
                why = why or str(error)
        return None, why

    found, why = at(1.0)
    if found is not None:
        return found
    still, reason = at(0.0)
    if still is None:
        raise InputError(reason)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        half = 0.5 * (low + high)
        low, high = (low, half) if at(half)[0] is None else (half, high)
    rate = math.degrees(norm(*swing.rate_rad_s))
    raise InputError(
        '`target` and `assurance.corridor` exclude each other: with these thrusters and errors '
        f'the corridor may turn at {low * rate:.4g} deg/s at most; got {rate:.4g} ({why})'
    )


def attitude_rad(settings: Assurance, scenario: Any) -> float:
    """Return the largest angle between the target's axes and those that assurance takes."""
    given = settings.attitude_error_deg
    return math.radians(norm(*scenario.target.known_error_deg) if given is None else given)


def _leaning(way: Passage, angle: float, reached_m: float) -> _Walls:
    """Return a corridor that is within all that are turned against it by at most an angle.

    reached_m : by so much the port's plane comes earlier too
    """
    tilt, reach = (1.0 + way.slope) * angle, way.port_m + SQRT_2 * way.width_m
    found = _Walls(
        way.port_m + angle * reach + reached_m,
        way.width_m - tilt * reach,
        way.slope - tilt * (1.0 + SQRT_2 * way.slope),
        way.closing_m_s - angle * SQRT_2 * way.lateral_m_s,
        way.lateral_m_s - angle * math.hypot(way.closing_m_s, SQRT_2 * way.lateral_m_s),
    )
    if min(found) < 0.0:
        raise InputError(
            '`assurance.attitude_error_deg` leaves nothing of the corridor; got '
            f'{math.degrees(angle):.6g}'
        )
    return found


class _Taken(NamedTuple):
    """What a corridor that turns takes of the thrusters, by the speed in it.

    push : authority of an axis [m/s^2]; swing : along the axis, and across it
    """

    guard: Guard
    way: Passage
    walls: _Walls
    swing: Swing
    push: float
    off: float
    tide: float
    coriolis: float

    def across_m_s(self, speed: float) -> float:
        """Return the largest speed [m/s] per axis across: half of the other, if the walls allow."""
        w = self.walls
        closes = math.sqrt(w.closing_m_s**2 + 2.0 * self.push * self.way.outer_m)
        follows = w.lateral_m_s + w.slope * (closes - w.closing_m_s)
        return min(max(0.5 * speed, follows), speed)

    def doubt(self, speed: float) -> float:
        """Return what the authority of an axis may be off [m/s^2], if no component is faster.

        docs/safety.md, lemma 5; speed : [m/s]
        """
        (a, p, q), (da, dp, dq) = self.swing.rate_rad_s, self.swing.change_rad_s2
        tick = 2.0 * self.push * self.guard.dt_s
        v, u = speed + tick, self.across_m_s(speed) + tick
        r = self._range_m(v)
        h = self.walls.width_m + self.walls.slope * r
        fast = SQRT_3 * v + norm(a, p, q) * r
        off = self.off + self.tide * r + self.coriolis * fast
        across = max(
            2.0 * (u * a + v * one) + h * (a * a + one * one) + other * (a * r + one * h) + d * r
            for one, other, d in ((q, p, dq), (p, q, dp))
        )
        across += da * h + off
        inward = 2.0 * u * (p + q) + a * (p + q) * h + (dp + dq) * h + off
        slope = self.walls.slope
        return max((across + slope * inward) / (1.0 - slope), inward + r * (p * p + q * q))

    def _range_m(self, speed: float) -> float:
        """Return the largest range at which the corridor, and not the open set, is kept."""
        g, fast = self.guard, SQRT_3 * speed
        near = g.keep_out_m - g.here_m
        whole = fast + norm(*self.swing.rate_rad_s) * self.way.outer_m
        closing = fast + 2.0 * (g.here_m_s + whole * g.here_m / near)
        stop = closing * closing / (2.0 * authority(self.way.outer_m + g.here_m, g))
        return min(self.way.outer_m, g.keep_out_m + 2.0 * g.here_m + stop) + 2.0 * fast * g.dt_s


def _turning(
    guard: Guard,
    settings: Assurance,
    scenario: Any,
    errors: Errors,
    swing: Swing,
    left: float,
) -> Guard:
    """Return the numbers of the corridor in turning axes; raises InputError.

    left : share of what the walls leave at rest that stays at the largest speed
    """
    way, n, dt, mass = settings.corridor, scenario.mean_motion_rad_s, guard.dt_s, guard.mass_kg
    rate, axis = norm(*swing.rate_rad_s), 'xyz'.index(way.along[1])
    box = (1.0 - 1e-9) * guard.limit_n / swing.spread
    push, most = box / mass, SQRT_3 * guard.limit_n / mass
    earlier = 0.5 * (most - push) * dt * dt
    walls = _leaning(way, attitude_rad(settings, scenario), earlier)
    here = guard.here_m, guard.here_m_s + rate * guard.here_m
    following = guard.next_m, guard.next_m_s + rate * guard.next_m
    # The thrust is constant in LVLH, and turns in these axes.
    off = (errors.thrust * SQRT_3 * box + errors.disturbance_n) / mass + SQRT_3 * push * rate * dt
    taken = _Taken(guard, way, walls, swing.about(axis), push, off, 3.0 * n * n, 2.0 * n)
    low, high = 0.0, speed_limit(way.outer_m, guard)
    high = min(high, (guard.top_m_s - rate * way.outer_m) / SQRT_3)
    enough = left * (push - taken.doubt(0.0))
    for _ in range(_HALVINGS):
        half = 0.5 * (low + high)
        low, high = (half, high) if push - taken.doubt(half) >= enough else (low, half)
    doubt = taken.doubt(low)
    wall, slope = push - doubt, walls.slope
    dip = (1.0 + slope) * ((1.0 + errors.thrust) * most + doubt) * dt * dt / 8.0
    across, least = taken.across_m_s(low), walls.closing_m_s + following[1]
    follows = slope * low + 2.0 * (1.0 + slope) * here[1] + push * dt
    if min(enough, wall, across - follows) <= 0.0 or low < least:
        raise InputError(
            f'in the corridor {low:.4g} m/s are kept for certain, and {least:.4g} m/s are needed'
        )
    numbers = walls.numbers(way, wall, doubt, dip, low, here, following, dt)
    growth = (across - walls.lateral_m_s) / (way.outer_m - walls.port_m)
    numbers['lateral_1_s'] = min(numbers['lateral_1_s'], max(growth, 0.0))
    return guard._replace(
        limit_n=box, top_m_s=low, here_m_s=here[1], next_m_s=following[1], **numbers
    )
