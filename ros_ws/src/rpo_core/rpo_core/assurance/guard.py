# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The constants of the proof (docs/safety.md), from a scenario and its section `assurance`.

Lemmas 3 and 4: the edge of the domain, and the speed that is kept for certain. Lemmas 4 and 5: the
corridor, whose walls stand in LVLH or turn with the target.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

from rpo_core.assurance.assumed import SQRT_3, Errors, ahead, errors_of, limit_n, unknown_n
from rpo_core.assurance.kernels import FAR, Guard, authority, fastest_after, speed_limit
from rpo_core.assurance.settings import LEAST_CHANGE, Assurance, Passage
from rpo_core.attitude.target import FIXED, known_motion
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.stage import Place, section_of

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

_TURNING_HALVINGS = 24

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
    walls = _Walls(way.port_m, way.width_m, slope, way.closing_m_s, way.lateral_m_s)
    return walls.numbers(way, wall, (1.0 + slope) * doubt, dip, top, here, following, dt)


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
    for _ in range(_TURNING_HALVINGS):
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
    walls = _Walls(
        way.port_m + angle * reach + reached_m,
        way.width_m - tilt * reach,
        way.slope - tilt * (1.0 + SQRT_2 * way.slope),
        way.closing_m_s - angle * SQRT_2 * way.lateral_m_s,
        way.lateral_m_s - angle * math.hypot(way.closing_m_s, SQRT_2 * way.lateral_m_s),
    )
    if min(walls) < 0.0:
        raise InputError(
            '`assurance.attitude_error_deg` leaves nothing of the corridor; got '
            f'{math.degrees(angle):.6g}'
        )
    return walls


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
    for _ in range(_TURNING_HALVINGS):
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


EDGE_SHARE = 0.6
"""Share of the domain beyond which its edge is in question; near the one that allows most speed."""

_HALVINGS = 60


def speed_floor(
    g: Guard,
    errors: Errors,
    settings: Assurance,
    scenario: Any,
    doubt: float,
    spare: float,
    rising: float,
) -> float:
    """Return the speed [m/s] above which the backup law brakes for certain.

    Errors of navigation make it push where it should brake; above this speed the chaser loses
    energy all the same. docs/safety.md, lemma 3.

    doubt : error of the speed along the range [m/s]
    spare : thrust [N] along the range that its authority leaves out
    rising : how fast the limit may rise where the law pushes the chaser inward [m/s^2]
    """
    m, dt, n = g.mass_kg, g.dt_s, scenario.mean_motion_rad_s
    off = errors.disturbance_n + errors.thrust * g.limit_n + 3.0 * m * n * n * settings.domain_m
    left = math.sqrt(g.limit_n * g.limit_n - g.brake_n * g.brake_n)
    left = left if g.keep_out_m > 0.0 else g.limit_n
    pushed = doubt + spare * dt / m + rising * dt
    second = g.brake_n * (g.brake_n - m * g.slowing_m_s2) + left * left
    second = 0.5 * dt / m * (second + off * (2.0 * g.limit_n + off))
    cost = g.here_m_s * g.limit_n + m * g.slowing_m_s2 * doubt + second
    along, across = g.brake_n - off - m * g.slowing_m_s2, left - off
    if min(along, across) <= 0.0:
        return math.inf
    against = (pushed * (g.brake_n + off + m * rising) + cost) / across
    return g.here_m_s + max(cost / min(along, across), math.hypot(against, pushed))


class _Edge:
    """The edge of the domain: what the backup law can do against leaving it.

    domain_m : range that the chaser does not leave at any tick, so that it does not between them
    from_m : below this range the chaser can stop before it anyway
    """

    def __init__(self, g: Guard, errors: Errors, settings: Assurance, scenario: Any) -> None:
        self._guard, self._errors = g, errors
        self._n, self._domain_m = scenario.mean_motion_rad_s, settings.domain_m
        force = SQRT_3 * g.limit_n + unknown_n(errors, scenario)
        self._pushed_m_s2 = force / g.mass_kg
        risen = self._pushed_m_s2 + self._n * self._n * settings.domain_m
        self.domain_m = settings.domain_m - risen * g.dt_s * g.dt_s / 8.0
        way = settings.corridor
        self.from_m = max(EDGE_SHARE * settings.domain_m, way.outer_m if way else g.keep_out_m)

    def _in_a_tick(self, speed_m_s: float) -> tuple[float, float, float]:
        """Return least range [m], largest speed, and way [m] of a tick that begins with a speed.

        It begins beyond `from_m`.
        """
        n, dt = self._n, self._guard.dt_s
        most = self._pushed_m_s2 + 3.0 * n * n * self._domain_m + 2.0 * n * speed_m_s
        quick = speed_m_s + most * dt
        return self.from_m - quick * dt, quick, (speed_m_s + 0.5 * most * dt) * dt

    def authority_m_s2(self, speed_m_s: float) -> float:
        """Return the deceleration outward that it has for certain up to a speed; below 0: none."""
        g, errors, n = self._guard, self._errors, self._n
        low, quick, moved = self._in_a_tick(speed_m_s)
        moved += g.here_m + g.here_m_s * g.dt_s
        if moved >= 0.5 * low:
            return -1.0
        kappa = moved / (low - moved)
        off = errors.thrust * g.limit_n + errors.disturbance_n
        sure = (g.brake_n * (1.0 - 0.5 * kappa * kappa) - kappa * g.limit_n - off) / g.mass_kg
        return sure - quick * quick / low - 2.0 * n * quick - 3.0 * n * n * self._domain_m

    def arriving_m_s(self, speed_m_s: float, push: tuple[float, float]) -> float:
        """Return the speed at the zone from which the backup law brakes to `speed_m_s` up to here.

        push : error of the closing speed near the zone [m/s], and thrust [N] against it; farther
            off, the law only brakes
        """
        g = self._guard
        a, pushed = authority(self.from_m, g), push[0] + push[1] * g.dt_s / g.mass_kg
        free_m = g.keep_out_m + g.here_m + 0.5 * pushed * (pushed / a + g.dt_s)
        way_m = max(self.from_m - free_m, 0.0)
        return math.sqrt(speed_m_s * speed_m_s + 2.0 * g.slowing_m_s2 * way_m)

    def brakes_who_leaves(self, way: Passage | None) -> bool:
        """Return whether who left the corridor faster than the limit has braked down to it here.

        In the corridor nothing brakes a chaser that recedes, and is pushed outward.
        """
        g, outer_m = self._guard, way.outer_m if way is not None else 0.0
        return g.doubt_m_s2 * outer_m <= g.slowing_m_s2 * (self.from_m - outer_m)

    def stops(self, speed_m_s: float) -> bool:
        """Return whether a chaser of that speed can stop between `from_m` and the edge."""
        a = self.authority_m_s2(speed_m_s)
        return a > 0.0 and speed_m_s * speed_m_s / (2.0 * a) <= self.domain_m - self.from_m

    def doubt_m_s(self, speed_m_s: float) -> float:
        """Return the error of the speed along the range."""
        g = self._guard
        return g.here_m_s + speed_m_s * g.here_m / (self._in_a_tick(speed_m_s)[0] - g.here_m)

    def has_room(self, authority_m_s2: float, speed_m_s: float) -> bool:
        """Return whether zone and edge never ask for thrust at the same time."""
        g = self._guard
        half = 0.5 * (self.domain_m - g.keep_out_m) - g.here_m
        a = min(authority_m_s2, g.authority_m_s2 - g.tide_1_s2 * self._domain_m)
        doubt = g.here_m_s + speed_m_s * g.here_m / max(g.keep_out_m - g.here_m, 1e-9)
        both = 2.0 * (g.brake_n * g.dt_s / g.mass_kg + doubt)
        return half > 0.0 and fastest_after(half, 0.0, a, g.dt_s) >= both


def within_domain(
    g: Guard,
    floor_m_s: float,
    push: tuple[float, float],
    errors: Errors,
    settings: Assurance,
    scenario: Any,
) -> tuple[Guard, float]:
    """Return the numbers with those of the domain's edge, and the speed that is kept for certain.

    The limit of the speed is lowered to what can stop before the edge.

    floor_m_s, push : that speed near the zone; what the zone asks for, as `arriving_m_s` takes it

    Raises InputError where the edge cannot be kept.
    """
    edge = _Edge(g, errors, settings, scenario)
    low, high = 0.0, speed_limit(settings.domain_m, g)
    low = high if edge.stops(high) else low
    for _ in range(_HALVINGS if low < high else 0):
        half = 0.5 * (low + high)
        low, high = (half, high) if edge.stops(half) else (low, half)
    fast = low
    while fast > 0.0 and edge.stops(fast):
        a = edge.authority_m_s2(fast)
        edged = g._replace(domain_m=edge.domain_m, top_m_s=low, edge_m_s2=a)
        spare, doubt = g.brake_n - g.mass_kg * a, edge.doubt_m_s(fast)
        floor = speed_floor(edged, errors, settings, scenario, doubt, spare, g.slowing_m_s2)
        if floor <= fast:
            kept = floor_m_s <= edge.arriving_m_s(fast, push) and edge.has_room(a, fast)
            if not kept or not edge.brakes_who_leaves(settings.corridor):
                break
            return edged, max(floor_m_s, floor)
        fast = 1.01 * floor
    raise InputError(
        f'`assurance.domain_m` must be a range that the chaser can be kept in; got '
        f'{settings.domain_m!r} m: with tides, `disturbance_n`, `thrust_error` and the errors of '
        f'position and velocity, it cannot stop for certain before that and before the zone of '
        f'`keep_out_m` = {settings.keep_out_m!r} m, at {fast:.6g} m/s'
    )


BRAKE_SHARE = 0.95
"""Share of a thruster axis that the backup law may push along the range; 0.31 is left across."""

SLACK = 0.9
"""Share of the sure deceleration that the speed limit may ask for."""

_TRIALS = 20


MOST_SHARE = 0.05
"""Share of the zone's radius: up to that error of position the authority of its law is computed."""


class Proof(NamedTuple):
    """The numbers of the filter, what they assume, and the speed that is kept for certain.

    floor_m_s : the true speed stays below the limit, or this (docs/safety.md, lemma 3)
    walls : numbers of the corridor in the axes of a target that turns; None: as `guard` has them
    """

    guard: Guard
    errors: Errors
    floor_m_s: float
    walls: Guard | None = None


def follows(settings: Assurance, scenario: Any) -> bool:
    """Return whether errors follow the spread of an estimator."""
    places = {section_of(s).place for s in scenario.sections}
    return settings.sigmas > 0.0 and Place.ESTIMATOR in places


def most_m(settings: Assurance, scenario: Any, errors: Errors) -> float:
    """Return the largest error [m] of position for which the constants of the zone hold."""
    if not follows(settings, scenario):
        return errors.position_m
    return max(errors.position_m, MOST_SHARE * settings.keep_out_m)


def guard_of(settings: Assurance, scenario: Any) -> Guard:
    """Return the numbers of the filter; raises InputError if constraints exclude each other."""
    return proof_of(settings, scenario).guard


@lru_cache(maxsize=256)
def proof_of(settings: Assurance, scenario: Any) -> Proof:
    """Return the constants of the proof; raises InputError if constraints exclude each other.

    The largest speed near the zone is that of the limit, or the one that is kept for certain, which
    depends on it: the first that is large enough.
    """
    errors = errors_of(settings, scenario)
    speed, zone = settings.speed, settings.keep_out_m
    top = speed.speed_m_s + speed.slope(scenario.mean_motion_rad_s) * zone
    top += math.sqrt(2.0 * speed.deceleration_m_s2 * zone)
    for _ in range(_TRIALS):
        guard = _guard(settings, scenario, errors, top)
        push = _zone_push(guard, settings)
        floor = speed_floor(guard, errors, settings, scenario, *push, 0.0)
        if floor == math.inf:
            break
        if zone > 0.0 and floor > top:
            top = 1.01 * floor
            continue
        if zone > 0.0:
            guard, floor = within_domain(guard, floor, push, errors, settings, scenario)
        if settings.corridor is None or scenario.target is None:
            return Proof(guard, errors, floor)
        walls = turning(guard, settings, scenario, errors)
        corridor_numbers = {name: getattr(walls, name) for name in NO_CORRIDOR}
        corridor_numbers['port_m'] = settings.corridor.port_m
        return Proof(guard._replace(**corridor_numbers), errors, floor, walls)
    raise InputError(
        f'`assurance` and `max_force_n` exclude each other: with errors of '
        f'{errors.position_m:.6g} m and {errors.velocity_m_s:.6g} m/s no speed is kept for certain'
    )


def _guard(settings: Assurance, scenario: Any, errors: Errors, top: float) -> Guard:
    """Return the numbers of the filter, if near the zone no speed is larger than `top` [m/s]."""
    limit, mass, dt = limit_n(scenario), errors.mass_kg, scenario.dt_s
    n2 = scenario.mean_motion_rad_s * scenario.mean_motion_rad_s
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    here, following = ahead(errors, scenario, delay), ahead(errors, scenario, delay + 1)
    zone, speed, way = settings.keep_out_m, settings.speed, settings.corridor
    no_walls = way is None or scenario.target is not None  # of one that turns, `turning` has them
    per_range = speed.slope(scenario.mean_motion_rad_s)
    brake = (BRAKE_SHARE if zone > 0.0 else 1.0) * limit
    off = errors.thrust * limit + errors.disturbance_n
    widest = errors._replace(position_m=most_m(settings, scenario, errors))
    dip, kappa = _between_ticks(errors, scenario, zone, top, ahead(widest, scenario, delay))
    sure = (brake * (1.0 - 0.5 * kappa * kappa) - kappa * limit - off) / mass
    slowing = SLACK * ((brake - off) / mass - 3.0 * n2 * settings.domain_m)
    _check_speed(speed, per_range, slowing, sure - n2 * settings.domain_m, settings)
    square = per_range * per_range
    knee = (slowing - per_range * speed.speed_m_s) / square if square > 0.0 else FAR
    return Guard(
        dt_s=dt,
        mass_kg=mass,
        limit_n=limit,
        slew_n=(settings.slew_n_s or 0.0) * dt,
        least=1.0 if settings.filter == LEAST_CHANGE else 0.0,
        keep_out_m=zone + dip if zone > 0.0 else 0.0,
        brake_n=brake,
        authority_m_s2=sure,
        tide_1_s2=n2,
        speed_m_s=speed.speed_m_s,
        speed_1_s=per_range,
        deceleration_m_s2=speed.deceleration_m_s2,
        slowing_m_s2=slowing,
        knee_m=knee,
        domain_m=settings.domain_m,
        top_m_s=FAR,
        edge_m_s2=1.0,
        here_m=here[0],
        here_m_s=here[1],
        next_m=following[0],
        next_m_s=following[1],
        **(NO_CORRIDOR if no_walls else standing(way, scenario, errors, here, following, settings)),
    )


def _zone_push(g: Guard, settings: Assurance) -> tuple[float, float]:
    """Return the error of the closing speed [m/s] near the zone, and what the authority leaves out.

    A chaser that recedes may be pushed by that thrust [N] along the range.
    """
    near = g.keep_out_m - g.here_m
    top = speed_limit(g.keep_out_m, g) + g.here_m_s
    doubt = g.here_m_s + (top * g.here_m / near if near > 0.0 else 0.0)
    return doubt, g.brake_n - g.mass_kg * (g.authority_m_s2 - g.tide_1_s2 * settings.domain_m)


def _between_ticks(
    errors: Errors, scenario: Any, zone_m: float, top_m_s: float, here: tuple[float, float]
) -> tuple[float, float]:
    """Return how far a path may dip below both ends of a tick [m], and a bound of the chord.

    The chord is the change of the direction to the target between the one that the filter uses and
    the true one at any time of the tick. docs/safety.md, "Between the ticks".
    """
    if zone_m <= 0.0:
        return 0.0, 0.0
    dt, n = scenario.dt_s, scenario.mean_motion_rad_s
    force = SQRT_3 * limit_n(scenario) + unknown_n(errors, scenario)
    acceleration = force / errors.mass_kg + 3.0 * n * n * zone_m + 2.0 * n * top_m_s
    bend = acceleration + top_m_s * top_m_s / zone_m
    moved = here[0] + (top_m_s + here[1]) * dt + 0.5 * acceleration * dt * dt
    if moved >= 0.5 * zone_m:
        raise InputError(
            f'`assurance.keep_out_m` and the assumed errors, or the way of a tick by `speed`, '
            'exclude each other: the direction to the target must be known to half the radius, '
            f'{0.5 * zone_m:.6g} m; got {moved:.6g} m'
        )
    return bend * dt * dt / 8.0, moved / (zone_m - moved)


def _check_speed(
    speed: Any, per_range: float, slowing: float, sure: float, settings: Assurance
) -> None:
    """Refuse limits that the thrusters cannot keep."""
    if min(slowing, sure) <= 0.0:
        raise InputError(
            '`assurance` must leave the thrusters something to brake with; the assumed errors '
            f'and tides up to domain_m = {settings.domain_m!r} m take all of it: '
            f'{min(slowing, sure):.6g} m/s^2 are left'
        )
    asked = max(speed.deceleration_m_s2, per_range * speed.speed_m_s)
    if asked >= slowing:
        raise InputError(
            f'`assurance.speed` and `max_force_n` exclude each other: the limit asks for '
            f'{asked:.6g} m/s^2, and {slowing:.6g} m/s^2 are sure'
        )
