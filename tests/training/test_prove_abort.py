# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""ARCH-COMP's rendezvous, proven: sets hold flights of SciPy, and planted errors are found."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
from invoking import invoke, refused
from scipy.integrate import solve_ivp

from rpo_core.files.scenario import load_scenario
from rpo_proof.exact import exact
from rpo_proof.sets import box_of
from tools import peers, rendezvous
from tools.rendezvous import exponential

pytestmark = pytest.mark.every_landing  # of a benchmark of others: kernels of its own

FILE = Path(__file__).parents[2] / 'offline_training/examples/benchmarks/arch_rendezvous.yaml'
LAWS = rendezvous.laws_of(load_scenario(FILE))

SPACEEX = (  # accelerations in 1/min^2 and 1/min, as the competition's model files have them
    (
        (-0.057599765881773, 0.000200959896519766, -2.89995083970656, 0.00877200894463775),
        (-0.000174031357370456, -0.0665123984901026, -0.00875351105536225, -2.90300269286856),
    ),
    (
        (-0.575999943070835, 0.000262486079431672, -19.2299795908647, 0.00876275931760007),
        (-0.000262486080737868, -0.575999940191886, -0.00876276068239993, -19.2299765959399),
    ),
    ((0.0000575894721132, 0.0, 0.0, 0.00876276), (0.0, 0.0, -0.00876276, 0.0)),
)


def of_minutes(rows):
    """Return the matrix of s' = A s in m and s."""
    zero, one = Fraction(0), Fraction(1)
    scales = (Fraction(1, 3600), Fraction(1, 3600), Fraction(1, 60), Fraction(1, 60))
    below = [[Fraction(repr(v)) * s for v, s in zip(row, scales, strict=True)] for row in rows]
    return [[zero, zero, one, zero], [zero, zero, zero, one], *below]


def as_floats(matrix):
    return np.array([[float(v) for v in row] for row in matrix])


def flown(laws, x, y, times):
    """Return states of the closed loop at some times, by SciPy, the switch found by its events."""
    far, near = as_floats(laws.far), as_floats(laws.near)

    def reaches(_, s):
        return s[0] - laws.switch_m

    reaches.terminal = True
    settings = {'rtol': 1e-11, 'atol': 1e-11, 'method': 'DOP853', 'dense_output': True}
    first = solve_ivp(
        lambda _, s: far @ s, (0, times[-1]), [x, y, 0, 0], events=reaches, **settings
    )
    at = first.t[-1]
    second = solve_ivp(lambda _, s: near @ s, (at, times[-1] + 1.0), first.y[:, -1], **settings)
    return [first.sol(t) if t < at else second.sol(t) for t in times]


def leaves(tables, laws, cell, rng, until_s=6780.0, flights=4):
    """Return how many of some flights are outside the boxes of the cell at any moment looked at."""
    c, g, d = rendezvous.set_of(cell)
    low, high, least, most = np.empty((4, 4))
    m, boxes = 2, []
    for _ in range(round(until_s / rendezvous.TICK_S)):
        box_of(c, g, d, m, low, high)
        m = rendezvous.tick(tables, c, g, d, m, low, high, least, most)
        boxes.append((least.copy(), most.copy()))
    ticks = np.unique(np.concatenate([np.arange(0, len(boxes), 500), np.arange(400, 420)]))
    ticks = np.concatenate([ticks, np.arange(round(6480 / rendezvous.TICK_S), len(boxes), 3)])
    ticks = np.unique(ticks[ticks < len(boxes)])
    out = 0
    for _ in range(flights):
        x, y = cell[0] + cell[2] * rng.uniform(-1, 1), cell[1] + cell[3] * rng.uniform(-1, 1)
        times = (ticks + rng.uniform(0, 1, len(ticks))) * rendezvous.TICK_S
        for k, s in zip(ticks, flown(laws, x, y, times), strict=True):
            if (s < boxes[k][0] - 1e-7).any() or (s > boxes[k][1] + 1e-7).any():
                out += 1
                break
    return out


@pytest.fixture(scope='module')
def tables():
    return rendezvous.tables_of(LAWS, 18000.0)


@pytest.mark.parametrize('time_s', [0.25, 15.0, 600.0])
def test_the_exponential_is_that_of_fifty_digits(time_s):
    with mpmath.workdps(50):
        for a in LAWS[:3]:
            if time_s > 1.0 and a is not LAWS.free:
                continue
            rows = [[mpmath.mpf(v.numerator) / v.denominator * time_s for v in row] for row in a]
            true, found = mpmath.expm(mpmath.matrix(rows)), exponential(a, time_s)
            for i in range(4):
                for j in range(4):
                    assert abs(true[i, j] - found[i, j]) <= abs(true[i, j]) * 2.0**-52


def test_an_exponential_that_floats_cannot_hold_is_refused():
    tiny = [[Fraction(0), Fraction(1, 10**90)], [Fraction(0), Fraction(0)]]
    with pytest.raises(ValueError, match='tiny entries'):
        exponential(tiny, 1.0)


def image_is_held(a, before, after, m):
    """Whether the set after a tick holds the image of the one before, in rational numbers."""
    c, g, d = (exact(v.tolist()) for v in before)
    new_c, new_g, new_d = (exact(v.tolist()) for v in after)
    with mpmath.workdps(50):
        rows = [[mpmath.mpf(v.numerator) / v.denominator * rendezvous.TICK_S for v in r] for r in a]
        true = mpmath.expm(mpmath.matrix(rows))
        moved = [[Fraction(str(true[i, j])) for j in range(4)] for i in range(4)]
    for k, row in enumerate(moved):
        off = abs(sum(r * v for r, v in zip(row, c, strict=True)) - new_c[k])
        off += sum(abs(r) * v for r, v in zip(row, d, strict=True))
        for j in range(m):
            off += abs(sum(row[i] * g[i][j] for i in range(4)) - new_g[k][j])
        if off > new_d[k]:
            return False
    return True


def moved_at_random(tables, rng, near):
    """Return a random set, what a tick makes of it, and the number of its generators."""
    m, scale = int(rng.integers(2, 40)), np.array([1.0, 1.0, 0.002, 0.002])
    c = np.array([-60.0 if near else -500.0, -20.0, 0.05, 0.01]) * rng.uniform(0.5, 1.0, 4)
    g = np.zeros((4, rendezvous.CAPACITY))
    g[:, :m] = rng.normal(size=(4, m)) * scale[:, None] / m
    d = rng.uniform(0, 1e-9, 4)
    before = c.copy(), g.copy(), d.copy()
    low, high, least, most = np.empty((4, 4))
    box_of(c, g, d, m, low, high)
    after_m = rendezvous.tick(tables, c, g, d, m, low, high, least, most)
    assert after_m == m
    return before, (c, g, d), m


def test_a_tick_holds_the_exact_image_of_the_set(tables):
    rng = np.random.default_rng(4)
    wrong = tables._replace(moved=tables.moved * (1.0 + 1e-11))
    for k in range(20):
        law = LAWS.near if k % 2 else LAWS.far
        assert image_is_held(law, *moved_at_random(tables, rng, k % 2))
        assert not image_is_held(law, *moved_at_random(wrong, rng, k % 2))


def test_cells_hold_flights_of_scipy_through_the_switch(tables):
    rng = np.random.default_rng(5)
    cells = rendezvous.first_cells()
    for k in (0, len(cells) // 2 + 1, len(cells) - 1):
        assert leaves(tables, LAWS, cells[k], rng) == 0


def test_a_wrong_gain_or_tick_is_found(tables):
    rng = np.random.default_rng(6)
    cell = rendezvous.first_cells()[90]
    weaker = [list(row) for row in LAWS.near]
    weaker[2][0] *= Fraction(99, 100)
    wrong = rendezvous.tables_of(LAWS._replace(near=weaker), 60.0)
    assert leaves(wrong, LAWS, cell, rng, 7500.0) > 0
    late = LAWS._replace(switch_m=-99.0)
    assert leaves(tables, late, cell, rng) > 0
    still = tables._replace(moved=np.array([np.eye(4)] * 3))
    assert leaves(still, LAWS, cell, rng, 300.0) > 0
    unpushed = tables._replace(push=0.0 * tables.push)
    assert leaves(unpushed, LAWS, cell, rng) > 0


def drifts(states, minutes):
    """Return the least larger of |x| and |y| of drifts of SciPy, sampled each second."""
    free = as_floats(LAWS.free)
    times = np.arange(0.0, 60.0 * minutes, 1.0)
    found = []
    for s in states:
        solved = solve_ivp(lambda _, v: free @ v, (0, times[-1]), s, rtol=1e-10, t_eval=times)
        found.append(float(np.abs(solved.y[:2]).max(axis=0).min()))
    return found


def aborts(rng):
    """Yield boxes of states such as aborts have."""
    for _ in range(12):
        x = -(10.0 ** rng.uniform(0, 2.5))
        middle = np.array([x, 0.3 * x, -x * 5e-4, -0.3 * x * 5e-4]) * rng.uniform(0.9, 1.1, 4)
        half = np.abs(middle) * 10.0 ** rng.uniform(-4, -1.5)
        yield middle - half, middle + half


def bad_bounds(tables, rng, minutes=60.0):
    """Return how many boxes have a drift that comes nearer than its bounds say, or not so near."""
    bad = 0
    last = round(60.0 * minutes / rendezvous.DRIFT_S)
    for low, high in aborts(rng):
        least, sure = rendezvous.nearest(tables, low, high, last)
        found = drifts([low, high, *rng.uniform(low, high, (2, 4))], minutes)
        bad += min(found) < least - 1e-9 or max(found) > sure + 1e-9
    return bad


def test_no_drift_comes_nearer_than_its_bound(tables):
    rng = np.random.default_rng(7)
    assert bad_bounds(tables, rng) == 0


def test_a_wrong_orbit_or_a_drift_that_ends_early_is_found(tables):
    rng = np.random.default_rng(7)
    faster = [[v * Fraction(21, 20) for v in row] for row in LAWS.free]
    faster[0][2] = faster[1][3] = Fraction(1)
    assert bad_bounds(rendezvous.tables_of(LAWS._replace(free=faster), 18000.0), rng) > 0
    low, high = next(aborts(np.random.default_rng(8)))
    assert rendezvous.nearest(tables, low, high, 40)[0] > min(drifts([low, high], 60.0))


def test_cells_and_their_halves_cover_the_starts():
    cells = rendezvous.first_cells()
    cells += [half for cell in cells[:30] for half in rendezvous._halves(cell)]
    area = sum(4 * a * b for _, _, a, b in cells[:200])
    assert area == pytest.approx(2500.0)
    for x, y in np.random.default_rng(9).uniform([-925, -425], [-875, -375], (500, 2)):
        assert any(abs(x - u) <= a and abs(y - v) <= b for u, v, a, b in cells[:200])
    assert sum(4 * a * b for _, _, a, b in cells[200:]) == pytest.approx(30 * 12.5)


def few_starts(monkeypatch):
    """Take only a square of 1 m in the corner of the starts."""
    monkeypatch.setattr(peers, 'STARTS_M', (-924.5, -424.5))
    monkeypatch.setattr(peers, 'STARTS_HALF_M', 0.5)
    monkeypatch.setattr(rendezvous, 'ACROSS', (1, 1))


def test_the_command_proves_what_is_safe_and_refutes_what_is_not(monkeypatch):
    few_starts(monkeypatch)
    done = invoke('safety', 'peers', FILE, '--prove')
    assert done.exit_code == 0, done.output
    said = {
        line.split()[0]: line.split()[-2:] for line in done.stdout.splitlines() if ' of 30' in line
    }
    assert set(said) == set(peers.ABORT_MIN)
    for name, verdicts in said.items():
        assert verdicts == ['proven', 'refuted' if name.startswith('SRU') else 'proven']
    # the flight that refutes, by SciPy: from the middle of the cell
    states = flown(LAWS, -924.5, -424.5, [15600.0])
    assert 0.1 < drifts(states, 40.0)[0] < 0.2
    assert 'SRU01: the flight from (-924.5, -424.5) m whose thrusters fail after 260' in done.stdout


def test_what_is_too_strict_stays_open(monkeypatch):
    few_starts(monkeypatch)
    monkeypatch.setattr(rendezvous, 'MOST_CELLS', 3)
    monkeypatch.setattr(peers, 'CONE_M_S', 2.9 / 60.0)
    proof = rendezvous.prove(LAWS, lambda *_: None)
    found = rendezvous.verdict(proof, 'SRA01')
    assert {said for _, said in found.boxes} == {'open'} and not found.as_expected
    assert np.isinf(found.speed_m_s) and found.near_m == 0.0
    assert np.isfinite(proof.trace.near).all()  # also of the moments just before it fails


def test_only_the_benchmark_with_a_proof_is_proven():
    other = str(FILE.with_name('vbar_approach.yaml'))
    assert 'must be one of arch_rendezvous' in refused('safety', 'peers', other, '--prove')


@pytest.mark.slow
@pytest.mark.parametrize('laws', [LAWS, rendezvous.Laws(*map(of_minutes, SPACEEX), -100.0)])
def test_every_instance_is_as_it_is_named(laws):
    proof = rendezvous.prove(laws, lambda *_: None)
    assert all(rendezvous.verdict(proof, name).as_expected for name in peers.ABORT_MIN)
