# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Zones as views draw them: those of the sections, in planes and in space."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rpo_core.files.scenario import load_scenario
from rpo_core.judge.zones import Corridor, Zones, zones_of
from rpo_guidance.plan import Guidance

near = st.floats(-50.0, 50.0)
directions = st.tuples(near, near, near).filter(lambda v: math.hypot(*v) > 1.0)


def corridor_along(axis, slope=0.2, half_width=0.3):
    size = math.hypot(*axis)
    return Corridor((1.0, 2.0, 3.0), tuple(a / size for a in axis), slope, 19.0, half_width)


def test_scenarios_say_what_is_about_their_target():
    assert zones_of(load_scenario('paper_test')) == []
    (plan,) = zones_of(load_scenario('hold_points'))
    assert plan.keep_out_m == 10.0
    assert plan.points_m == {
        'hold_60': (0.0, 60.0, 0.0), 'hold_20': (0.0, 20.0, 0.0), 'retreat': (0.0, 60.0, 0.0),
    }  # fmt: skip
    (assured,) = zones_of(load_scenario('assured'))
    # a square of half-width W lies in the circle of the cone where its corners do
    cone, tip = math.tan(math.radians(10.0)), assured.corridor.half_width_m
    for along in (0.0, 5.0, 19.0):
        corner = math.sqrt(2.0) * (tip + assured.corridor.slope * along)
        assert corner == pytest.approx(math.sqrt(2.0) * tip + cone * along)


@given(directions, st.floats(0.0, 19.0), st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 2.0))
def test_the_walls_are_where_the_lines_are_drawn(axis, along, turn, share):
    corridor = corridor_along(axis)
    rim, *edges = (np.array(line) for line in corridor.lines())
    middle = np.array(corridor.end_m)
    assert np.linalg.norm(rim - middle, axis=1) == pytest.approx(corridor.end_half_width_m)
    assert (rim - middle) @ np.array(corridor.ahead) == pytest.approx(0.0, abs=1e-9)
    for edge in edges:
        for place in np.linspace(*edge, 5):
            assert corridor.outside_m(tuple(place)) == pytest.approx(0.0, abs=1e-9)
    u = (rim[0] - middle) / corridor.end_half_width_m
    v = np.cross(corridor.ahead, u)
    radius = share * (corridor.half_width_m + corridor.slope * along)
    point = np.array(corridor.tip_m) + along * np.array(corridor.ahead)
    point += radius * (math.cos(turn) * u + math.sin(turn) * v)
    assume(abs(share - 1.0) > 1e-6)
    assert (corridor.outside_m(tuple(point)) < 0.0) == (share < 1.0)


@given(directions, st.sampled_from([(1, 0), (1, 2), (0, 2)]))
def test_edges_hold_the_whole_cone_of_a_plane_that_holds_its_axis(axis, plane):
    """Of an axis in the plane, the edges are the outline of the cone, seen from above."""
    axis = [a if i in plane else 0.0 for i, a in enumerate(axis)]
    assume(math.hypot(*axis) > 1.0)
    corridor = corridor_along(axis)
    edges = corridor.edges(*plane)
    seen = np.array([line for line in corridor.lines()[0]])[:, plane]
    side = np.array([-corridor.ahead[plane[1]], corridor.ahead[plane[0]]])
    drawn = [float(side @ np.array(edge[1])) for edge in edges]
    shadow = seen @ side
    assert max(drawn) >= shadow.max() - 1e-9 and min(drawn) <= shadow.min() + 1e-9
    assert max(drawn) - min(drawn) == pytest.approx(2.0 * corridor.end_half_width_m)
    upright = corridor_along([float(i not in plane) for i in range(3)])
    assert upright.edges(*plane) == []


@given(st.tuples(near, near, near))
def test_outside_agrees_with_guidance(position):
    settings = load_scenario('around').section(Guidance)
    (zones,) = zones_of(load_scenario('around'))
    expected = settings.corridor.outside_m(position, settings.port_m)
    assert zones.corridor.outside_m(position) == pytest.approx(expected, abs=1e-9)


def test_what_violates_a_zone():
    zones = Zones(10.0, Corridor((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 0.2, 19.0))
    inside = [(0.0, 5.0, 0.0), (0.5, 5.0, 0.0), (0.0, 11.0, 9.0)]
    outside = [(0.0, -5.0, 0.0), (1.0, 5.0, 0.0), (0.0, 0.5, 0.0)]
    assert not any(map(zones.violated, inside)) and all(map(zones.violated, outside))
    assert not any(map(Zones().violated, itertools.chain(inside, outside)))
