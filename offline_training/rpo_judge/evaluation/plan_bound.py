# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The energy of a plan beside other paths of the same begin, end and time out of the same zones.

Others are all paths of Clohessy and Wiltshire with a force that is held for each tick, that at each
tick keep out of the sphere or are in the cone of the corridor. Two numbers frame the least energy
of these: a lower bound, below all of them (`lower_bound`), and the best that a search found
(`best_path`), which is one of them, and keeps to the force of the thrusters too.

Within half-spaces n_j . r(t_j) >= b_j the least energy is a quadratic program (`Bridge`): the
position at a tick is linear in the forces. All that it needs of the motion is the least-energy path
without half-spaces, and how much a push at one of the ticks moves the positions at all of them (a
Gramian, conditioned on the end). Its dual has a multiplier for each half-space. Any multipliers
>= 0 give a lower bound of the energy: what `Bridge.least` returns needs no trust in how they were
found.

The zones are those of the target, whose attitude at each tick is known: a position in its axes is
linear in the forces too. So positions, planes and paths are in these axes; forces are in LVLH.

The zones are not convex. At any one moment a path is in the cone, or it is out of the sphere in one
of eight octants. So the paths fall into nine sets, each within a convex one: the cone in the
pyramid of planes about it; an octant out of the sphere beyond the plane through the three corners
of its spherical triangle. Branch and bound: the set with the lowest value is split at the moment
when its path is deepest in the zone; a triangle is split into four. The lowest value of all sets
that are left is below every path.

The best path comes from successive convex programs. Before a moment of entry the sphere gives way
to half-spaces tangent to it where the path before came closest; from then on the path is in a
pyramid in the cone. The moment is searched to both sides. The result is flown tick by tick, and is
in no zone at any tick.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from heapq import heappop, heappush
from itertools import product
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from rpo_attitude.target import known_motion
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.judge.zones import along_and_across, beside_m
from rpo_core.world import cw
from rpo_guidance.guidance import CONE_SHARE
from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import Checked, nominal
from rpo_guidance.transfer_kernels import path_of
from rpo_kernels.arrays import Floats, contracted
from rpo_kernels.kernels import CwStep, cw_step
from rpo_montecarlo.campaign.single import scenario_of
from rpo_montecarlo.campaign.store import Store

SIDES = 16
"""Planes of the pyramid about the cone, or in it."""


class KeepOut(NamedTuple):
    """A sphere, and a cone through it.

    radius_m : 0: none
    port_m, axis : (3,) tip of the cone, unit vector outward
    slope : tangent of its half angle; 0: none
    """

    radius_m: float
    port_m: Floats
    axis: Floats
    slope: float

    @classmethod
    def of(cls, settings: Guidance, margins: bool) -> KeepOut:
        """Return the zones of a plan; with `margins` as transfers keep to them."""
        corridor, radius, slope = settings.corridor, settings.keep_out_m, 0.0
        if radius and corridor.from_m:
            slope = corridor.slope * (CONE_SHARE if margins else 1.0)
        if radius and margins:
            radius += settings.margin_m
        return cls(radius, np.array(settings.port_m), np.array(corridor.ahead), slope)

    def depth_m(self, positions: Floats) -> Floats:
        """Return how far (n,) [m] positions (n, 3) lie inside the sphere and beside the cone."""
        depth: Floats = self.radius_m - np.linalg.norm(positions, axis=1)
        return np.minimum(depth, self.beside_m(positions)) if self.slope else depth

    def beside_m(self, positions: Floats) -> Floats:
        """Return how far (n,) [m] positions (n, 3) lie beside the cone, across its axis."""
        along, across = along_and_across(positions.T, self.port_m, self.axis)
        beside: Floats = beside_m(along, np.linalg.norm(across, axis=0), 0.0, self.slope)
        return beside

    def pyramid(self, share: float = 1.0) -> tuple[Floats, Floats]:
        """Return planes n . r >= b, (SIDES, 3) and (SIDES,), that touch a cone of such a slope."""
        turned = np.cross(self.axis, np.eye(3)[int(np.abs(self.axis).argmin())])
        turned /= np.linalg.norm(turned)
        angles = np.arange(SIDES)[:, None] * (2.0 * np.pi / SIDES)
        outward = np.cos(angles) * turned + np.sin(angles) * np.cross(self.axis, turned)
        normals = share * self.slope * self.axis - outward
        return normals, normals @ self.port_m


RIDGE = 1e-9
"""Added to the diagonal of the scaled dual, so that half-spaces that contradict each other have
finite multipliers; the bound is computed without it."""


class HalfSpaces(NamedTuple):
    """Half-spaces n . r(t_j) >= b: which of the ticks (m,), n (m, 3), b (m,) [m]."""

    when: NDArray[np.int64]
    normals: Floats
    least: Floats

    def with_more(self, more: HalfSpaces) -> HalfSpaces:
        """Return these and more."""
        return HalfSpaces(*(np.concatenate(pair) for pair in zip(self, more, strict=True)))


class Bridge:
    """All paths from a state to a state (6,) [m, m/s], seen at every `hold` of their ticks.

    turned : (length + 1, 3, 3) from the axes in which positions are seen to LVLH; None: LVLH
    ticks : (n,) at which positions are seen
    free : least energy [N^2 s] of all paths; path : (n, 3) [m] of that one
    """

    def __init__(
        self,
        start: Floats,
        end: Floats,
        step: CwStep,
        dt_s: float,
        length: int,
        hold: int,
        turned: Floats | None = None,
    ) -> None:
        if length < 4:
            raise InputError(f'a plan must have at least 4 ticks; got {length}')
        self._start, self._step, self._dt_s, self._length = start, step, dt_s, length
        a, self._b = cw.matrices(step)
        self._a, state, gramian = a, start, np.zeros((6, 6))
        self.ticks = np.arange(hold, length, hold)
        self._turned = np.eye(3)[None].repeat(length + 1, axis=0) if turned is None else turned
        axes = self._turned[self.ticks]
        states, gramians = [], []
        for _ in range(length):  # the drift, and what forces of unit energy reach
            state, gramian = a @ state, a @ gramian @ a.T + self._b @ self._b.T / dt_s
            states.append(state)
            gramians.append(gramian)
        self._end_gramian, self._missing = gramian, end - state
        motion, count = np.linalg.matrix_power(a, hold), len(self.ticks)
        products = np.zeros((count, count, 3, 3))
        self._to_end = np.empty((count, 3, 6))
        for i, tick in enumerate(self.ticks):
            later = gramians[tick - 1][:3]
            for k in range(i, count):
                products[i, k], products[k, i] = later[:, :3], later[:, :3].T
                later = later @ motion.T
            rest = np.linalg.matrix_power(a, length - tick)
            self._to_end[i] = axes[i].T @ gramians[tick - 1][:3] @ rest.T
        products = np.einsum('iba,ikbc,kcd->ikad', axes, products, axes, optimize=True)
        flat = self._to_end.reshape(-1, 6)
        given_end = flat @ np.linalg.solve(gramian, flat.T)
        self._products = products - given_end.reshape(count, 3, count, 3).transpose(0, 2, 1, 3)
        multiplier = np.linalg.solve(gramian, self._missing)
        self.free = float(self._missing @ multiplier)
        drift = np.einsum('iba,ib->ia', axes, np.array(states)[self.ticks - 1, :3])
        self.path = drift + self._to_end @ multiplier

    def least(self, spaces: HalfSpaces) -> tuple[float, Floats]:
        """Return the least energy [N^2 s] within half-spaces, and its multipliers (m,) >= 0.

        No path within them needs less, whatever the multipliers are: it is the value of the dual,
        2 d'u - u'Q u. They are found as least squares of u >= 0 (Lawson and Hanson, Solving least
        squares problems, 1974, chapter 23).
        """
        when, normals, least = spaces
        if not len(when):
            return self.free, np.zeros(0)
        blocks = self._products[when[:, None], when]
        q = np.einsum('ai,abij,bj->ab', normals, blocks, normals)
        scale = 1.0 / np.sqrt(np.diag(q))
        q *= scale[:, None] * scale
        room = (least - (normals * self.path[when]).sum(axis=1)) * scale
        root = np.linalg.cholesky(q + RIDGE * np.eye(len(q)))
        u, _ = nnls(root.T, np.linalg.solve(root, room), maxiter=100 * len(q))
        return self.free + max(0.0, float(2.0 * room @ u - u @ q @ u)), u * scale

    def path_of(self, spaces: HalfSpaces, multipliers: Floats) -> Floats:
        """Return the path (n, 3) [m] of the optimum that has these multipliers."""
        chosen = np.flatnonzero(multipliers)
        pushes = spaces.normals[chosen] * multipliers[chosen, None]
        moved = contracted('jmik,mk->ji', self._products[:, spaces.when[chosen]], pushes)
        return self.path + moved

    def forces(self, spaces: HalfSpaces, multipliers: Floats) -> Floats:
        """Return the forces (length, 3) [N] of the optimum that has these multipliers."""
        pushes = np.zeros((self._length + 1, 3))
        weighted = spaces.normals * multipliers[:, None]
        axes = self._turned[self.ticks[spaces.when]]
        np.add.at(pushes, self.ticks[spaces.when], np.einsum('mab,mb->ma', axes, weighted))
        moved = contracted('mik,mi->k', self._to_end[spaces.when], weighted)
        forces = np.empty((self._length, 3))
        adjoint = np.linalg.solve(self._end_gramian, self._missing - moved)
        for tick in range(self._length - 1, -1, -1):
            forces[tick] = adjoint @ self._b / self._dt_s
            adjoint = adjoint @ self._a
            adjoint[:3] += pushes[tick]
        return forces

    def energy(self, forces: Floats) -> float:
        """Return the energy [N^2 s] of forces (length, 3) [N]."""
        return float((forces * forces).sum()) * self._dt_s

    def flown(self, forces: Floats) -> Floats:
        """Return the states (length + 1, 6) that forces (length, 3) lead through."""
        states = np.empty((len(forces) + 1, 6))
        path_of(tuple(self._start.tolist()), forces, self._step, states)
        return states

    def seen(self, states: Floats) -> Floats:
        """Return the positions (length + 1, 3) of states of LVLH, as all positions here."""
        positions: Floats = np.einsum('iba,ib->ia', self._turned, states[:, :3])
        return positions


SETS = 2000
"""It ends after so many sets were split, ..."""

DEPTH_M = 0.1
"""... or when the path of the lowest set is nowhere deeper in the zone."""

ROUNDING = 1e-6
"""Share that the bound is lowered by, for rounding of the Gramians."""


class Lower(NamedTuple):
    """A lower bound.

    energy : [N^2 s], no path needs less
    path : (n, 3) [m] of the set that has it, perhaps somewhat in the zone
    closed : whether it is in the zone nowhere by more than DEPTH_M, so that the bound is near
    """

    energy: float
    path: Floats
    closed: bool


class _Triangle:
    """A triangle of directions (3, 3): beyond the plane of its corners, at a radius of 1."""

    def __init__(self, corners: Floats) -> None:
        self._corners = corners

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Planes n . r >= b at a radius of 1: of its corners, and of its sides."""
        a, b, c = self._corners
        normals = np.array([np.cross(b - a, c - a), np.cross(a, b), np.cross(b, c), np.cross(c, a)])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        normals *= np.sign(normals @ self._corners.sum(axis=0))[:, None]
        return normals, np.array([normals[0] @ a, 0.0, 0.0, 0.0])

    @cached_property
    def parts(self) -> list[_Triangle]:
        """Four triangles that make it up."""
        a, b, c = self._corners
        ab, bc, ca = (m / np.linalg.norm(m) for m in (a + b, b + c, c + a))
        parts = ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))
        return [_Triangle(np.array(part)) for part in parts]


_OCTANTS = [_Triangle(np.diag(signs)) for signs in product((1.0, -1.0), repeat=3)]

_Set = dict[int, _Triangle | None]
"""Where a path is at some of the ticks of the bridge: beyond a triangle, or, None, in the cone."""


def _spaces(chosen: _Set, zone: KeepOut, pyramid: tuple[Floats, Floats]) -> HalfSpaces:
    """Return the half-spaces of a set."""
    planes = [pyramid if part is None else part.planes for part in chosen.values()]
    radii = [1.0 if part is None else zone.radius_m for part in chosen.values()]
    return HalfSpaces(
        np.repeat(list(chosen), [len(least) for _, least in planes]),
        np.concatenate([normals for normals, _ in planes]),
        np.concatenate([least * radius for (_, least), radius in zip(planes, radii, strict=True)]),
    )


def _depth_m(chosen: _Set, zone: KeepOut, path: Floats) -> Floats:
    """Return how deep (n,) [m] a path of a set is in the zone at each tick, as the set has it."""
    depth = zone.depth_m(path)
    for j, part in chosen.items():
        depth[j] = -np.inf if part is None else zone.radius_m - float(np.linalg.norm(path[j]))
    return depth


def lower_bound(bridge: Bridge, zone: KeepOut) -> Lower:
    """Return a lower bound of the energy of all paths of a bridge out of a zone."""
    pyramid = zone.pyramid()
    first: list[_Triangle | None] = [*([None] if zone.slope else []), *_OCTANTS]
    sets: list[tuple[float, int, _Set, Floats]] = [(bridge.free, 0, {}, np.zeros(0))]
    made = 1
    for splits in range(SETS + 1):
        energy, _, chosen, multipliers = sets[0]
        path = bridge.path
        if chosen:
            path = bridge.path_of(_spaces(chosen, zone, pyramid), multipliers)
        depth = _depth_m(chosen, zone, path)
        deepest = int(depth.argmax())
        closed = bool(depth[deepest] <= DEPTH_M)
        if closed or splits == SETS:
            break
        heappop(sets)
        part = chosen.get(deepest)
        for smaller in first if part is None else part.parts:
            following = {**chosen, deepest: smaller}
            value, multipliers = bridge.least(_spaces(following, zone, pyramid))
            heappush(sets, (max(energy, value), made, following, multipliers))
            made += 1
    return Lower(energy * (1.0 - ROUNDING), path, closed)


ROUNDS = 60
"""Convex programs of one moment of entry at most, ..."""

SETTLED = 1e-5
"""... which end when the energy changes by no more than this share."""

NEAR = 1.3
"""A path gets half-spaces where it is nearer to the target than this many radii."""

INSIDE = 0.98
"""Slope of the pyramid in the cone, as a share."""

TOLERANCE_M = 1e-3

LARGER_M = (0.005, 0.01, 0.02, 0.04, 0.08)
"""Between the ticks that programs look at, a path may be nearer: the sphere is drawn so much
larger, and the cone smaller by such a share, until every tick is clear."""


class Found(NamedTuple):
    """A path.

    energy : [N^2 s]; positions_m : (length + 1, 3) of each tick; forces : (length, 3) [N]
    """

    energy: float
    positions_m: Floats
    forces: Floats

    def keeps(self, zone: KeepOut, limit_n: float) -> bool:
        """Return whether no tick is in a zone, or needs more force on an axis than there is."""
        clear = float(zone.depth_m(self.positions_m[1:-1]).max()) <= 0.0
        return clear and float(np.abs(self.forces).max()) <= limit_n


class _Settled(NamedTuple):
    energy: float
    path: Floats
    spaces: HalfSpaces
    multipliers: Floats


def _settle(
    bridge: Bridge, zone: KeepOut, share: float, path: Floats, entry: int
) -> _Settled | None:
    """Return the best path near a path that is in the cone from a tick of the bridge on."""
    sides, least = zone.pyramid(share)
    first = SIDES if entry < len(path) else 0
    cuts = HalfSpaces(np.full(first, entry), sides[:first], least[:first])
    before = np.inf
    for _ in range(ROUNDS):
        distance = np.linalg.norm(path, axis=1)
        near = np.flatnonzero(distance[: entry + 1] < NEAR * zone.radius_m)
        normals = path[near] / np.maximum(distance[near], 1e-9)[:, None]
        tangent = HalfSpaces(near, normals, np.full(len(near), zone.radius_m))
        spaces = tangent.with_more(cuts)
        energy, multipliers = bridge.least(spaces)
        path = bridge.path_of(spaces, multipliers)
        beyond = least - path[entry:] @ sides.T
        ticks = np.flatnonzero(beyond.max(axis=1, initial=0.0) > TOLERANCE_M)
        worst = beyond[ticks].argmax(axis=1)
        if not len(ticks) and abs(energy - before) <= SETTLED * energy:
            return _Settled(energy, path, spaces, multipliers)
        cuts = cuts.with_more(HalfSpaces(entry + ticks, sides[worst], least[worst]))
        before = energy
    return None


def _search(bridge: Bridge, zone: KeepOut, share: float, path: Floats) -> _Settled | None:
    """Return the best path near a path, over moments of entry."""
    count = len(path)
    if not zone.slope:
        return _settle(bridge, zone, share, path, count)
    outside = np.flatnonzero(zone.beside_m(path) > TOLERANCE_M)
    entry = min(int(outside[-1]) + 1 if len(outside) else 0, count - 1)
    best, step = _settle(bridge, zone, share, path, entry), count // 8
    while step:
        for other in (entry - step, entry + step):
            if 0 <= other < count:
                found = _settle(bridge, zone, share, path if best is None else best.path, other)
                if found is not None and (best is None or found.energy < best.energy):
                    best, entry = found, other
                    break
        else:
            step //= 2
    return best


def best_path(bridge: Bridge, zone: KeepOut, guess: Floats, limit_n: float) -> Found | None:
    """Return the best path of a bridge out of a zone that is found near a path; None if none.

    guess : (n, 3) [m] at the ticks of the bridge
    limit_n : largest force of an axis
    """
    for larger_m in LARGER_M:
        larger = zone._replace(radius_m=zone.radius_m + larger_m)
        best = _search(bridge, larger, INSIDE - larger_m, guess)
        if best is None:
            return None
        forces = bridge.forces(best.spaces, best.multipliers)
        found = Found(bridge.energy(forces), bridge.seen(bridge.flown(forces)), forces)
        if found.keeps(zone, limit_n):
            return found
        guess = best.path
    return None


BOUND_TICKS, PATH_TICKS = 60, 150
"""At about so many ticks the bound, and the programs of the best path, look at the zones."""


class Bound(NamedTuple):
    """Energies [N^2 s] from the start to the end of the last leg.

    plan : of the reference; best : of the best path found; lower : no path needs less
    positions_m : (n, 3) of the best path found, each tick, in the axes of the target
    duration_s : of all
    closed : whether the search for the bound came to its end
    """

    plan: float
    best: float
    lower: float
    positions_m: Floats
    duration_s: float
    closed: bool


def bound(settings: Guidance, scenario: Scenario, margins: bool = False) -> tuple[Checked, Bound]:
    """Return the plan, flown without errors, and its bounds.

    margins : whether the zones of others are those that transfers plan with

    The best path has energy inf and no positions if none is found.
    """
    planned = scenario if settings.mass_kg is None else replace(scenario, mass_kg=settings.mass_kg)
    found = nominal(settings, scenario)
    over = len(found.changes) > len(settings.legs)
    last = found.changes[len(settings.legs)].tick if over else scenario.ticks
    end = cw_step(found.references[last - 1], found.forces[last - 1], planned.step)
    # a plan for another mass commands another force; the flight needs that of its own mass
    forces = np.array(found.forces[:last]) * (scenario.mass_kg / planned.mass_kg)
    states = np.array([*found.references[:last], end])
    zone = KeepOut.of(settings, margins)
    motion, turned = known_motion(scenario), None
    if motion is not None:
        turned = motion.frames(last + 1)[:, :9].reshape(-1, 3, 3)
    coarse, fine = (
        Bridge(states[0], states[-1], scenario.step, scenario.dt_s, last, -(-last // ticks), turned)
        for ticks in (BOUND_TICKS, PATH_TICKS)
    )
    lower, positions = lower_bound(coarse, zone), fine.seen(states)
    seen = np.vstack([positions[0], lower.path, positions[-1]])
    ticks = [0, *coarse.ticks.tolist(), last]
    guess = np.column_stack([np.interp(fine.ticks, ticks, axis) for axis in seen.T])
    plan = Found(fine.energy(forces), positions, forces)
    others = [best_path(fine, zone, guess, scenario.max_force_n), plan]
    known = [path for path in others if path and path.keeps(zone, scenario.max_force_n)]
    best = min(known, key=lambda path: path.energy, default=Found(inf, np.empty((0, 3)), forces))
    energies = (plan.energy, best.energy, lower.energy, best.positions_m)
    return found, Bound(*energies, last * scenario.dt_s, lower.closed)


def rows(found: Checked, scenario: Scenario) -> list[tuple[str, ...]]:
    """Return a row of text for each phase: name, times, energy, least range, largest force, why."""
    ends = [*(change.tick for change in found.changes[1:]), scenario.ticks + 1]
    table: list[tuple[str, ...]] = []
    for change, end in zip(found.changes, ends, strict=True):
        states = np.array(found.references[change.tick : end])
        forces = np.array(found.forces[change.tick : end])
        numbers = (
            f'{change.tick * scenario.dt_s:.1f}',
            f'{(end - 1) * scenario.dt_s:.1f}',
            f'{float((forces * forces).sum()) * scenario.dt_s:.4f}',
            f'{float(np.linalg.norm(states[:, :3], axis=1).min()):.2f}',
            f'{float(np.abs(forces).max()):.3f}',
        )
        table.append((change.phase, *numbers, change.reason))
    return table


class Ratio(NamedTuple):
    """Energies of one run [N^2 s]: flown, of its plan, of the best path found, lower bound."""

    run: int
    flown: float
    plan: float
    best: float
    lower: float


def ratios(store: Store, sample: int, advance: Callable[[int], None]) -> list[Ratio]:
    """Return the energies of some runs, evenly spaced; raises InputError without a plan.

    advance : gets how many are done
    """
    campaign, runs = store.campaign, store.campaign.config.runs
    settings = campaign.scenario.section(Guidance)
    if settings is None:
        raise InputError(f'scenario {campaign.scenario.name} has no section `guidance`')
    flown = store.column('energy_n2s')
    found = []
    for done, run in enumerate(np.linspace(0, runs - 1, min(sample, runs)).round().astype(int)):
        scenario = scenario_of(campaign, int(run))
        own = scenario.section(Guidance) or settings
        _, energies = bound(own, scenario)
        found.append(Ratio(int(run), float(flown[run]), *energies[:3]))
        advance(done + 1)
    return found
