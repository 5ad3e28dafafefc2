# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Legs: the force of a reference carries a free chaser along it."""

from __future__ import annotations

import numpy as np
import pytest
from references import VEHICLE

from rpo_core.guidance.legs import (
    FlyingAround,
    Straight,
    Times,
    Transferring,
    profile,
    progress,
)
from rpo_core.guidance.transfers import Limits
from rpo_core.world import cw

REST = (0.0, -60.0, 0.0, 0.0, 0.0, 0.0)

LEGS = {
    'transfer': lambda: Transferring(
        REST, lambda ticks: (0.0, 20.0, 0.0, 0.0, 0.0, 0.0), VEHICLE, Times(200.0), Limits(13.0)
    ),
    'straight': lambda: Straight(REST, (10.0, -20.0, 5.0), VEHICLE, 0.3, 0.0),
    'around': lambda: FlyingAround(REST, (0.0, 40.0, 0.0), VEHICLE, 0.5),
    'out of plane': lambda: FlyingAround(REST, (0.0, 0.0, 50.0), VEHICLE, 0.5),
}


@pytest.mark.parametrize('name', LEGS)
def test_a_chaser_with_the_force_of_the_reference_stays_on_it(name):
    leg = LEGS[name]()
    state, worst = leg.at(0)[0], 0.0
    for tick in range(leg.ticks):
        reference, force = leg.at(tick)
        worst = max(worst, float(np.abs(np.subtract(state, reference)[:3]).max()))
        assert max(map(abs, force)) <= VEHICLE.limit_n
        state = cw.cw_step(state, force, VEHICLE.step)
    # a transfer is planned with held forces; lines and arcs are followed as a force of ticks can
    assert worst < (1e-6 if name == 'transfer' else 0.2)


@pytest.mark.parametrize('name', LEGS)
def test_a_leg_is_a_function_of_its_tick(name):
    """Asked again, or with ticks left out, it answers the same bits."""
    one, two = LEGS[name](), LEGS[name]()
    ticks = [0, 1, 2, 7, 8, 40, 41, 500, 501]
    every = {tick: one.at(tick) for tick in range(502)}
    assert [two.at(tick) for tick in ticks] == [every[tick] for tick in ticks]
    rows = np.empty((502, 9))
    two.fill(rows)
    np.testing.assert_array_equal(rows, [np.hstack(row) for row in every.values()])


@pytest.mark.parametrize(
    ('start', 'half_way'),
    [
        ((40.0, 0.0, 0.0), (0.0, 0.0, 40.0)),
        ((0.0, 0.0, -40.0), (-40.0, 0.0, 0.0)),
        ((24.0, 0.0, 32.0), (-32.0, 0.0, 24.0)),
    ],
)
def test_half_a_turn_leads_by_below_or_out_of_plane(start, half_way):
    leg = FlyingAround((*start, 0.0, 0.0, 0.0), tuple(-x for x in start), VEHICLE, 0.5)
    places = np.array([leg.at(tick)[0][:3] for tick in range(leg.ticks + 1)])
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 40.0)
    np.testing.assert_allclose(places[-1], np.negative(start), atol=1e-5)
    np.testing.assert_allclose(places[len(places) // 2], half_way, atol=0.1)


def test_a_line_to_where_it_begins_is_over_at_once():
    leg = Straight((*REST[:3], 0.1, 0.0, 0.0), REST[:3], VEHICLE, 0.3, 0.0)
    assert leg.ticks == 0 and leg.moved(3.0) == (REST, (0.0, 0.0, 0.0))
    short = Straight(REST, (0.0, -60.0, 1e-5), VEHICLE, 0.3, 0.0)
    assert short.ticks > 0


@pytest.mark.parametrize(
    ('length', 'first', 'cruise', 'last'),
    [(40.0, 0.0, 0.3, 0.0), (1.0, 0.0, 0.3, 0.0), (19.0, 0.0, 0.1, 0.07), (0.5, 0.2, 0.3, 0.0),
     (0.01, 0.2, 0.3, 0.0), (30.0, 0.1, 0.1, 0.1)],
)  # fmt: skip
def test_a_profile_covers_its_length(length, first, cruise, last):
    speeds = profile(length, first, cruise, last, 0.015)
    times = np.linspace(0.0, speeds.duration_s, 2001)
    found = np.array([progress(speeds, t) for t in times])
    assert found[0, 0] == pytest.approx(0.0)
    assert found[-1, 0] == pytest.approx(length)
    assert found[0, 1] == pytest.approx(first)
    assert found[-1, 1] == pytest.approx(last, abs=1e-9)
    assert found[:, 1].max() <= cruise + 1e-12
    np.testing.assert_allclose(
        ((found[1:, 1] + found[:-1, 1]) / 2.0 * np.diff(times)).sum(), length, rtol=1e-3
    )


def test_a_short_leg_from_rest_to_rest_is_flown_and_not_skipped():
    """By rounding, every other such leg took no time, and the reference jumped to its end."""
    for length in np.linspace(0.01, 6.0, 500).tolist():
        speeds = profile(length, 0.0, 0.3, 0.0, 0.015)
        assert speeds.duration_s == pytest.approx(2.0 * np.sqrt(length / 0.015))  # up and down
        assert progress(speeds, 0.5 * speeds.duration_s)[0] == pytest.approx(0.5 * length)
