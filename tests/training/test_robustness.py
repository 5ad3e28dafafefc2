# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Margins and describing functions against closed forms, against flights, and against deceit."""

from __future__ import annotations

from dataclasses import replace
from math import asin, atan2, degrees, pi, sqrt

import numpy as np
import pytest
from invoking import invoke
from landing import rest_at_landing

from rpo.analysis import robustness
from rpo.analysis.robustness import Margin, Off, Quantity, search
from rpo_core.chain.flight import fly
from rpo_core.control.baselines import Pd
from rpo_core.control.controller import load_controller
from rpo_core.judge.metrics import UNITS, row_of
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import load_set
from rpo_core.thrusters.thrusters import Thrusters

MASS_KG, DT_S, LIMIT_N = 10.0, 0.1, 0.5
DELAY = next(q for q in robustness.QUANTITIES if q.name == 'delay')
LOSS = next(q for q in robustness.QUANTITIES if q.name == 'thrust loss')


def pd(position_gain: float, velocity_gain: float) -> Pd:
    return Pd(
        name='spring', position_gain_n_m=position_gain, velocity_gain_n_s_m=velocity_gain,
        max_force_n=LIMIT_N,
    )  # fmt: skip


def textbook(kp: float, kd: float) -> tuple[float, float, float]:
    """Return crossing [rad/s], phase margin [rad], delay margin [s] of (kp + kd s) / (m s^2)."""
    m = MASS_KG
    rate = sqrt((kd * kd + sqrt(kd**4 + 4.0 * kp * kp * m * m)) / (2.0 * m * m))
    phase = atan2(kd * rate, kp) - rate * DT_S / 2.0
    return rate, phase, phase / rate


@pytest.mark.parametrize('kp, kd', rest_at_landing([(2.0, 6.0), (0.01, 0.5), (0.5, 0.2)]))
def test_an_unsaturated_pd_has_the_crossing_of_the_textbook(kp, kd, monkeypatch):
    monkeypatch.setattr(robustness, 'AMPLITUDES_M', (0.05,))
    assert robustness.crossings(load_controller('drift'), MASS_KG, DT_S) == []
    (found,) = robustness.crossings(pd(kp, kd), MASS_KG, DT_S)
    rate, phase, delay_s = textbook(kp, kd)
    assert found.amplitude_m == 0.05
    assert found.rate_rad_s == pytest.approx(rate, rel=1e-6)
    assert found.phase_margin_deg == pytest.approx(degrees(phase), rel=1e-5)
    assert found.delay_margin_s == pytest.approx(delay_s, rel=1e-5)
    assert found.delay_margin_ticks == pytest.approx(delay_s / DT_S, rel=1e-5)


@pytest.mark.parametrize('amplitude', [0.5, 1.0, 4.0, 40.0])
def test_saturation_has_its_describing_function(amplitude):
    """N = 2 k / pi (asin s + s sqrt(1 - s^2)), s = limit / (k A): Gelb and Vander Velde."""
    k = 1.0
    s = min(1.0, LIMIT_N / (k * amplitude))
    wanted = 2.0 * k / pi * (asin(s) + s * sqrt(1.0 - s * s))
    (found,) = robustness.describing(pd(k, 0.0), 1, amplitude, DT_S, np.array([0.1]))
    assert found.real == pytest.approx(wanted, rel=2e-4) and abs(found.imag) < 1e-12


@pytest.mark.every_landing
def test_the_predicted_delay_margin_is_that_of_flights():
    """An unsaturated loop dies out at the largest whole delay below the margin, not above it."""
    gains = (2.0, 6.0)
    base = replace(
        load_set('paper_training').base, initial_position_m=(0.0, 0.0, 0.01), duration_s=120.0
    )

    def grows(ticks: float) -> tuple[float, str]:
        scenario = base.equipped(Thrusters(delay_ticks=int(ticks)))
        z = np.abs(fly(scenario, pd(*gains)).states[:, 2])
        return float(z[-300:].max() / z[400:700].max()), 'growth'

    flown = search(DELAY._replace(bound=40.0), grows)
    predicted = robustness.crossings(pd(*gains), MASS_KG, DT_S)[0].delay_margin_ticks
    assert flown.holds == int(predicted) and flown.fails == int(predicted) + 1


def test_flights_that_are_off_are_those_of_the_chain():
    """Each kind of being off, together, against one flight after the other through the core."""
    off = Off(thrust=0.9, mass=1.2, delay_ticks=3, position_m=0.02, velocity_m_s=-0.001)
    controller = load_controller('time_to_go')
    flights = robustness.Flights(controller)
    found = flights.shares(flights.starts, off)
    scenarios = list(load_set('paper_training').scenarios())
    for number in (0, 77, 215):
        scenario = replace(scenarios[number], mass_kg=12.0).equipped(
            Thrusters(matrix=tuple(map(tuple, (0.9 * np.eye(3)).tolist())), delay_ticks=3),
            Navigation(position_bias_m=(0.02,) * 3, velocity_bias_m_s=(-0.001,) * 3),
        )
        row = dict(zip(UNITS, row_of(fly(scenario, controller)), strict=True))
        limits = flights.starts.config.success
        wanted = {name: row[name] / limit for name, limit in limits.items()}
        assert {name: found[name][number] for name in found} == pytest.approx(wanted, rel=1e-12)


def shorter(controller):
    """Return the flights of a controller, of which the drawn ones end after 40 s."""
    flights = robustness.Flights(controller)
    short = replace(flights.drawn.scenario, duration_s=40.0)
    flights.drawn = replace(flights.drawn, scenario=short)
    return flights


def test_drawn_flights_feel_all_that_is_off(monkeypatch):
    """Where a sensor measures, its bias changes: that of navigation would change nothing."""
    monkeypatch.setattr(robustness, 'RUNS', 4)
    flights = shorter(load_controller('time_to_go'))
    offs = [Off(0.8), Off(thrust=0.9), Off(mass=1.1), Off(delay_ticks=2.0), Off(position_m=0.05)]
    nominal = flights.shares(flights.drawn, Off())
    for off in (*offs, Off(velocity_m_s=0.001)):
        found = flights.shares(flights.drawn, off)
        assert (found['mean_error_norm_m'] != nominal['mean_error_norm_m']).all(), off


@pytest.mark.parametrize('gain', [0.5, 2.5])
def test_gain_comes_before_the_limit(gain, monkeypatch):
    """A PD with gain k is the PD with gains k times as large, saturated or not."""
    monkeypatch.setattr(robustness, 'RUNS', 20)
    flights, scaled = shorter(pd(0.01, 0.5)), shorter(pd(gain * 0.01, gain * 0.5))
    for one, other in ((flights.starts, scaled.starts), (flights.drawn, scaled.drawn)):
        found, wanted = flights.shares(one, Off(gain=gain)), scaled.shares(other)
        for name in wanted:
            assert found[name] == pytest.approx(wanted[name], rel=1e-6, abs=1e-9), name


# The search.

SHARE = Quantity('x', lambda x: [Off(mass=1.0 + x)], 0.0, 31.0, 0.1, '{:g}', 'kg')


def margin_of(fails, quantity=SHARE) -> Margin:
    return search(quantity, lambda x: (2.0, 'it') if fails(x) else (0.5, 'it'))


@pytest.mark.parametrize('bound', [0.0004, 0.013, 0.31, 1.7, 29.9])
def test_a_bound_is_found_to_a_hundredth(bound):
    found = margin_of(lambda x: x > bound)
    assert found.holds <= bound < found.fails
    assert found.fails - found.holds <= max(0.01 * found.fails, 0.0021)
    assert found.holds_again is None


def test_a_bound_below_nominal_and_of_whole_numbers():
    found = margin_of(lambda x: x < 0.62, SHARE._replace(nominal=1.0, bound=0.01))
    assert found.holds >= 0.62 > found.fails > 0.61
    assert margin_of(lambda x: x > 30, DELAY)[2:4] == (30.0, 31.0)


def test_nothing_is_claimed_beyond_what_was_checked():
    found = margin_of(lambda x: False)
    assert found.fails is None and found.holds == SHARE.bound == found.points[-1].at
    with pytest.raises(robustness.InputError, match='x: the claim must hold at nominal'):
        margin_of(lambda x: True)


def test_a_claim_that_fails_and_holds_again_is_reported_as_such():
    """Doubling steps and bisection see 1.0 alone; the points between see the gap below it."""
    found = margin_of(lambda x: 0.2 < x < 0.35 or x > 1.0, LOSS)
    assert found.holds <= 0.2 < found.fails < 0.35 < found.holds_again
    assert all(point.holds for point in found.points if point.at <= found.holds)
    margins = robustness.Margins({}, 0, (found,), ())
    (row,) = robustness.rows_of(margins)
    assert 'NOT monotone: holds again at' in row[-1]
    assert robustness.cells(margins.numbers())[1].endswith('!')


# The command.


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(robustness, 'QUANTITIES', (LOSS._replace(digits=1, first=0.4),))


@pytest.mark.every_landing
def test_margins_are_printed(quick):
    done = invoke('evaluate', 'mpc', '--robustness')
    assert done.exit_code == 0, done.output
    assert 'NOT judged, because missed when nothing is off: ' in done.output
    assert 'of paper_test_measured, seed' in done.output and 'slew per axis;' in done.output
    (line,) = (line for line in done.output.splitlines() if 'thrust loss' in line)
    assert '10.0 %' in line and '20.0 %' in line and 'starts: speed' in line


@pytest.mark.every_landing
def test_a_start_that_misses_leaves_no_margins(quick):
    done = invoke('evaluate', 'handmade', '--robustness')
    assert done.exit_code == 1 and 'no margins: 24 of the starts' in done.output
    assert 'thrust loss' not in done.output and 'phase margin' in done.output
