# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A certificate of the control surface: claims proven over the whole input square, or refuted.

The square is covered by boxes on which `surface` bounds the output and its slopes; boxes are
divided where the bounds do not decide. A claim is

- proven: it holds at every point of the square;
- refuted: it fails at a point, which is named and where the kernel was evaluated;
- undecided: neither, within the boxes allowed.

Errors and outputs are normalised. Slopes and falls are those of F, the inference in real arithmetic
on the numbers of the file; the kernel computes F to within `Certificate.rounding`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpo.proof import surface
from rpo.proof.surface import Boxes, Enclosure
from rpo_core.control.fuzzy import FuzzySystem
from rpo_core.kernels.arrays import Bools, Floats

PROVEN, REFUTED, UNDECIDED = 'proven', 'refuted', 'undecided'


def verdict_of(limit: float, bound: float, value: float) -> str:
    """Return the verdict of a limit: no value exceeds `bound`, and `value` is one of them."""
    if value > limit:
        return REFUTED
    return PROVEN if bound <= limit else UNDECIDED


MAX_FALL = 0.1
"""Share of full output that the force may fall as an error grows, by default.

No centroid of clipped triangles is monotone: it dips a little between two peaks.
"""

MOST_BOXES = 60_000
"""Boxes that each claim may take, by default; with fewer, bounds are wider."""

_GRID = 1 / 64  # widest box to start with
_TOLERANCE = 0.02  # boxes are divided until a bound is within 2 % of what was found
_STEP = 2.0**-20  # of difference quotients; rounding spoils them by 1e-7


class Point(NamedTuple):
    """Errors in [-1, 1], and the output that the kernel gives there."""

    position_error: float
    velocity_error: float
    output: float


@dataclass(frozen=True)
class Claim:
    """One claim.

    statement : what is claimed, with its numbers
    verdict : `PROVEN`, `REFUTED` or `UNDECIDED`
    bound : what is proven: no point exceeds it
    found : the greatest value seen, at `points`; `bound` - `found` is what is left open
    points : the witness; of a refuted claim, its counterexample
    """

    name: str
    statement: str
    verdict: str
    bound: float
    found: float
    points: tuple[Point, ...] = ()


@dataclass(frozen=True)
class Certificate:
    """All claims; boxes : evaluated in all; rounding : of the kernel against F."""

    claims: tuple[Claim, ...]
    boxes: int
    rounding: float

    @property
    def holds(self) -> bool:
        """Whether every claim is proven."""
        return all(claim.verdict == PROVEN for claim in self.claims)


def certify(
    system: FuzzySystem, max_fall: float = MAX_FALL, most_boxes: int = MOST_BOXES
) -> Certificate:
    """Return the certificate of a fuzzy system."""
    return _Examination(system, max_fall, most_boxes).certificate()


class _Examination:
    """The grid and the enclosures that the claims share."""

    def __init__(self, system: FuzzySystem, max_fall: float, most_boxes: int) -> None:
        self.system, self.max_fall, self.most_boxes = system, max_fall, most_boxes
        self.boxes = 0
        self.rounding = surface.rounding(system)
        self.e = surface.divided(surface.breakpoints(system.position), _GRID)
        self.v = surface.divided(surface.breakpoints(system.velocity), _GRID)
        e, v = np.meshgrid(self.e, self.v)
        self.grid = surface.values(system, e.ravel(), v.ravel()).reshape(e.shape)
        self.cover = surface.tensor(self.e, self.v)
        self.enclosure = self.enclose(self.cover)

    def enclose(self, boxes: Boxes) -> Enclosure:
        self.boxes += len(boxes.e_low)
        return surface.enclose(self.system, boxes)

    def point(self, e: float, v: float) -> Point:
        """Return a point with the output of the kernel."""
        return Point(float(e), float(v), self.system.output(float(e), float(v)))

    def certificate(self) -> Certificate:
        errors = list(enumerate(('position error', 'velocity error')))
        claims = (
            self.output_bound(),
            *(self.lipschitz(name, axis) for axis, name in errors),
            self.oddness(),
            *(self.monotonicity(name, axis) for axis, name in errors),
            self.equilibrium(),
            self.pull(),
        )
        return Certificate(claims, self.boxes, self.rounding)

    def branch(
        self,
        score: Callable[[Enclosure], Floats],
        value: float,
        improve: Callable[[Boxes], float] | None = None,
    ) -> float:
        """Return a bound of `score` on the square; divide boxes until it is near `value`."""
        boxes, enclosure = self.cover, self.enclosure
        bound, spent = value, 0
        while True:
            scores = score(enclosure)
            if improve:
                best = np.argsort(scores)[-256:]
                value = max(value, improve(boxes.where(best)))
            target = value * (1.0 + _TOLERANCE) + 1e-9
            open_ = scores > target
            bound = max(bound, float(scores[~open_].max(initial=value)))
            spent += 4 * int(open_.sum())
            if not open_.any() or spent > self.most_boxes:
                return max(bound, float(scores.max()))
            boxes = boxes.where(open_).quartered()
            enclosure = self.enclose(boxes)

    def output_bound(self) -> Claim:
        """Claim a bound of |u|; a centroid of samples of [-1, 1] is at most 1."""
        row, column = np.unravel_index(np.abs(self.grid).argmax(), self.grid.shape)
        witness = self.point(self.e[column], self.v[row])
        largest = abs(witness.output)
        bound = self.branch(lambda box: np.maximum(-box.low, box.high), largest)
        bound = min(bound, 1.0) + self.rounding
        statement = f'|u| <= {bound:.4f} of full force'
        return Claim('output', statement, PROVEN, bound, largest, (witness,))

    def lipschitz(self, name: str, axis: int) -> Claim:
        """Claim a Lipschitz constant in one error."""
        jump = self._widest_jump(axis)
        if jump:
            change = abs(jump[0].output - jump[1].output)
            statement = f'u jumps by {change:.4f} between neighbouring numbers'
            return Claim(f'slope in {name}', statement, REFUTED, np.inf, np.inf, jump)
        best: list[tuple[float, tuple[Point, ...]]] = [(0.0, ())]

        def improve(boxes: Boxes) -> float:
            best.append(max(best[-1], self._steepest(boxes, axis), key=lambda pair: pair[0]))
            return best[-1][0]

        bound = self.branch(
            lambda box: np.maximum(-box[2 + 2 * axis], box[3 + 2 * axis]), 0, improve
        )
        steepest, points = best[-1]
        verdict = PROVEN if np.isfinite(bound) else UNDECIDED
        statement = f'|du| <= {bound:.3f} |d({name})|'
        return Claim(f'slope in {name}', statement, verdict, bound, steepest, points)

    def _steepest(self, boxes: Boxes, axis: int) -> tuple[float, tuple[Point, ...]]:
        """Return the greatest difference quotient from the middles of boxes, and its two points."""
        middle = [low + (high - low) / 2 for low, high in (boxes[:2], boxes[2:])]
        other = list(middle)
        other[axis] = middle[axis] + np.minimum(_STEP, (boxes[2 * axis + 1] - middle[axis]) / 2)
        steps = other[axis] - middle[axis]
        wide = steps > _STEP / 4
        if not wide.any():
            return 0.0, ()
        change = surface.values(self.system, *other) - surface.values(self.system, *middle)
        quotients = np.where(wide, np.abs(change) / np.where(wide, steps, 1.0), 0.0)
        i = int(quotients.argmax())
        points = self.point(middle[0][i], middle[1][i]), self.point(other[0][i], other[1][i])
        return abs(points[1].output - points[0].output) / float(steps[i]), points

    def _widest_jump(self, axis: int) -> tuple[Point, Point] | None:
        """Return the ends of the widest jump at a breakpoint, one unit in the last place apart."""
        functions = (self.system.position, self.system.velocity)[axis]
        edges = surface.breakpoints(functions)
        inner = edges[(edges != 0.0) & (np.abs(edges) < 1.0)]
        moving = np.concatenate([inner, inner])
        beside = np.concatenate([np.nextafter(inner, -2.0), np.nextafter(inner, 2.0)])
        others = (self.v, self.e)[axis]
        pairs = []
        for ends in (moving, beside):
            first, second = np.repeat(ends, len(others)), np.tile(others, len(ends))
            pairs.append((first, second) if axis == 0 else (second, first))
        change = np.abs(np.subtract(*(surface.values(self.system, *pair) for pair in pairs)))
        if not change.size or change.max() < 1e-6:
            return None
        i = int(change.argmax())
        (e, v), (e_beside, v_beside) = pairs
        return self.point(e[i], v[i]), self.point(e_beside[i], v_beside[i])

    def oddness(self) -> Claim:
        """Claim F(-e, -v) = -F(e, v), bit for bit."""
        statement = 'u(-e, -v) = -u(e, v)'
        if self.system.rules.is_odd:
            # By construction: grades are those of |x| mirrored, samples are summed in mirrored
            # pairs; so the 25 rules decide.
            return Claim('oddness', f'{statement}, bit for bit', PROVEN, 0.0, 0.0)
        e, v = (axis.ravel() for axis in np.meshgrid(self.e, self.v))
        sums = np.abs(self.grid.ravel() + surface.values(self.system, -e, -v))
        i = int(sums.argmax())
        points = self.point(e[i], v[i]), self.point(-e[i], -v[i])
        error = abs(points[0].output + points[1].output)
        c = self.cover
        mirror = self.enclose(Boxes(-c.e_high, -c.e_low, -c.v_high, -c.v_low))
        here = self.enclosure
        bound = float(np.maximum(here.high + mirror.high, -here.low - mirror.low).max())
        verdict = REFUTED if error > 0.0 else UNDECIDED
        return Claim('oddness', f'{statement}; off by {error:.4f}', verdict, bound, error, points)

    def monotonicity(self, name: str, axis: int) -> Claim:
        """Claim that the force falls by at most `max_fall` as one error grows."""
        fall = _FallSearch(self, axis)
        bound, largest, points = fall.search()
        verdict = verdict_of(self.max_fall, bound, largest)
        seen = f'; {largest:.4f} seen' if largest > self.rounding else '; no fall was seen'
        allowed = f'(allowed {self.max_fall:g})'
        statement = f'u falls by at most {bound:.4f} as the {name} grows {allowed}{seen}'
        return Claim(f'monotone in {name}', statement, verdict, bound, largest, points)

    def equilibrium(self) -> Claim:
        """Claim that there is no force at rest at the target."""
        origin = self.point(0.0, 0.0)
        size = abs(origin.output)
        verdict = REFUTED if size else PROVEN
        return Claim('equilibrium', f'u(0, 0) = {origin.output:g}', verdict, size, size, (origin,))

    def pull(self) -> Claim:
        """Claim that at rest anywhere else the force points to the target."""
        name, statement = 'pull', 'at rest, u has the sign of the position error, which is not 0'
        zero = np.zeros_like(self.e)
        wrong = -np.sign(self.e) * surface.values(self.system, self.e, zero)
        push = np.where(self.e == 0.0, -np.inf, wrong)
        witness = self.point(self.e[push.argmax()], 0.0)
        worst = float(-np.sign(witness.position_error) * witness.output)
        if worst >= 0.0:
            return Claim(name, statement, REFUTED, np.inf, worst, (witness,))
        edges = self.e
        for _ in range(20):
            left, right = edges[:-1], edges[1:]
            none = np.zeros_like(left)
            box = self.enclose(Boxes(left, right, none, none))
            origin = (left == 0.0) | (right == 0.0)  # there u is 0: a rising u has the sign of e
            proven = np.where(
                origin, box.e_slope_low > 0.0, np.where(left > 0.0, box.low > 0.0, box.high < 0.0)
            )
            if proven.all() and self.system.output(0.0, 0.0) == 0.0:
                return Claim(name, statement, PROVEN, 0.0, worst, (witness,))
            middles = (left + (right - left) / 2)[~proven]
            edges = np.sort(np.concatenate([edges, middles]))
        return Claim(name, statement, UNDECIDED, np.inf, worst, (witness,))


class _Strip(NamedTuple):
    """The boxes between `edges` of the growing error, where the other is in [low, high]."""

    edges: Floats
    low: float
    high: float


class _FallSearch:
    """Bounds the fall of F along one error, strip by strip of the other."""

    def __init__(self, examination: _Examination, axis: int) -> None:
        self.examination, self.axis, self.found = examination, axis, 0.0
        self.points: tuple[Point, ...] = ()
        functions = (examination.system.position, examination.system.velocity)[axis]
        self.continuous = surface.is_continuous(functions)

    def search(self) -> tuple[float, float, tuple[Point, ...]]:
        """Return the proven bound of the fall, the greatest seen, and its two points."""
        edges, others = self.examination.e, self.examination.v
        if self.axis:
            edges, others = others, edges
        if self.examination.system.rules.is_odd:  # the other half mirrors this one
            others = others[others >= 0.0]
        strips = [_Strip(edges, *pair) for pair in itertools.pairwise(others)]
        bounds, rising = self._bounds(strips)
        spent = 0
        while True:
            for i in np.argsort(bounds)[-24:]:
                self._look(strips[i])
            worst = float(bounds.max())
            target = max(1.05 * self.found, self.found + 2e-3)
            open_ = bounds > max(target, (self.found + worst) / 2)  # the worst first
            halves = [half for i in np.flatnonzero(open_) for half in _halves(strips[i], rising[i])]
            spent += sum(len(half.edges) for half in halves)
            if not halves or spent > self.examination.most_boxes:
                return max(worst, self.found), self.found, self.points
            new_bounds, new_rising = self._bounds(halves)
            kept = np.flatnonzero(~open_)
            strips = [*(strips[i] for i in kept), *halves]
            rising = [*(rising[i] for i in kept), *new_rising]
            bounds = np.concatenate([bounds[kept], new_bounds])

    def _bounds(self, strips: list[_Strip]) -> tuple[Floats, list[Bools]]:
        """Return the bound of each strip, and for each of its boxes whether F surely rises."""
        left = np.concatenate([strip.edges[:-1] for strip in strips])
        right = np.concatenate([strip.edges[1:] for strip in strips])
        counts = [len(strip.edges) - 1 for strip in strips]
        low = np.repeat([strip.low for strip in strips], counts)
        high = np.repeat([strip.high for strip in strips], counts)
        boxes = Boxes(low, high, left, right) if self.axis else Boxes(left, right, low, high)
        box = self.examination.enclose(boxes)
        slope, cuts = box[2 + 2 * self.axis], np.cumsum(counts)[:-1]
        columns = (np.split(column, cuts) for column in (box.low, box.high, slope, right - left))
        bounds = [self._fall(*strip) for strip in zip(*columns, strict=True)]
        return np.array(bounds), np.split(slope >= 0.0, cuts)

    def _fall(self, low: Floats, high: Floats, slope: Floats, width: Floats) -> float:
        """Return the bound of the fall along one strip, from its boxes.

        From the outputs: the highest so far less the lowest now. From the slopes, if F is
        continuous: the rise over consecutive boxes is at least the sum of least slope times width.
        """
        bound = float((np.maximum.accumulate(high) - low).max())
        if self.continuous and np.isfinite(slope).all():
            steps = slope * width
            rise = np.concatenate([[0.0], np.cumsum(steps)])
            slack = 4.0 * len(rise) * surface.UNIT_ROUNDOFF * float(np.abs(steps).sum())
            bound = min(bound, float((np.maximum.accumulate(rise) - rise).max()) + slack)
        return bound

    def _look(self, strip: _Strip) -> None:
        """Look for a fall along the middle of a strip; keep the greatest that the kernel shows."""
        middle = strip.low + (strip.high - strip.low) / 2
        other = np.full_like(strip.edges, middle)
        points = (other, strip.edges) if self.axis else (strip.edges, other)
        output = surface.values(self.examination.system, *points)
        end = int((np.maximum.accumulate(output) - output).argmax())
        start = int(output[: end + 1].argmax())
        pair = tuple(self.examination.point(points[0][i], points[1][i]) for i in (start, end))
        fall = pair[0].output - pair[1].output
        if fall > self.found:
            self.found, self.points = fall, pair


def _halves(strip: _Strip, rising: Bools) -> list[_Strip]:
    """Return both halves of a strip, its boxes divided where F may fall."""
    left, right = strip.edges[:-1], strip.edges[1:]
    edges = np.sort(np.concatenate([strip.edges, (left + (right - left) / 2)[~rising]]))
    middle = strip.low + (strip.high - strip.low) / 2
    return [_Strip(edges, strip.low, middle), _Strip(edges, middle, strip.high)]
