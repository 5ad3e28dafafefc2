# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Section `zones`, beside files from before it; zones as views draw them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.assurance.settings import Assurance
from rpo_core.files.validation import InputError
from rpo_core.guidance.guidance import Guidance
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import load_scenario
from rpo_core.world.zones import Cone, Zone, zones_of

OLD = files.parse_yaml(Path(__file__).with_name('before_zones.yaml').read_text())
"""Sections of shipped scenarios as files had them before section `zones`."""

near = st.floats(-50.0, 50.0)
directions = st.tuples(near, near, near).filter(lambda v: math.hypot(*v) > 1.0)


def corridor_along(axis, slope=0.2, half_width=0.3):
    size = math.hypot(*axis)
    return Cone((1.0, 2.0, 3.0), tuple(a / size for a in axis), slope, 19.0, half_width)


def test_scenarios_say_what_is_about_their_target():
    assert zones_of(load_scenario('paper_test')) == []
    (plan,) = zones_of(load_scenario('hold_points'))
    assert plan.keep_out_m == 10.0
    assert plan.points_m == {
        'hold_60': (0.0, 60.0, 0.0), 'hold_20': (0.0, 20.0, 0.0), 'retreat': (0.0, 60.0, 0.0),
    }  # fmt: skip
    _, assured = zones_of(load_scenario('assured'))
    # a square of half-width W lies in the circle of the cone where its corners do
    cone, tip = math.tan(math.radians(10.0)), assured.corridor.half_width_m
    for along in (0.0, 5.0, 19.0):
        corner = math.sqrt(2.0) * (tip + assured.corridor.slope * along)
        assert corner == pytest.approx(math.sqrt(2.0) * tip + cone * along)


def document(name):
    return files.parse_yaml(files.read_text(files.find('scenario', name)))


@pytest.mark.parametrize('name', OLD)
def test_a_file_without_the_section_means_the_same(name):
    old = {**document(name), **OLD[name]}
    del old['zones']
    found, expected = scenario.parse(old), load_scenario(name)
    assert found.zones is None and expected.zones is not None
    assert found == expected and found.requirements == expected.requirements


@pytest.mark.parametrize('name', OLD)
def test_zones_are_written_once(name):
    expected = load_scenario(name)
    text = scenario.dumps(expected)
    for field in (' keep_out_m:', ' half_angle_deg:', ' port_m:'):
        assert text.count(field) == 1
    found = scenario.parse(files.parse_yaml(text))
    assert found == expected and found.zones == expected.zones
    assert found.requirements == expected.requirements


def test_a_section_may_differ_from_the_zones():
    data = document('docking')
    data['zones']['keep_out_m'] = 11.0
    data['assurance']['keep_out_m'] = 9.0
    found = scenario.parse(data)
    assert found.section(Guidance).keep_out_m == found.requirements.keep_out_m == 11.0
    assert found.section(Guidance).corridor.from_m == 13.0 < found.zones.corridor.from_m
    assert found.section(Assurance).keep_out_m == 9.0


@pytest.mark.parametrize(
    'changes', [{'axis': [0.0, 1.0, 1.0]}, {'from_m': 0.0}, {'axis': [1.0, 0.0, 0.0]}]
)
def test_assurance_needs_a_corridor_along_an_axis_through_the_target(changes):
    data = document('assured')
    data['zones']['corridor'].update(changes)
    with pytest.raises(InputError, match=r'needs a `zones\.corridor`'):
        scenario.parse(data)
    own = {'along': '+y', 'half_angle_deg': 10.0, 'port_m': 1.0, 'outer_m': 20.0}
    data['assurance']['corridor'] = own  # of its own: those of the zones may be any
    assert scenario.parse(data) == load_scenario('assured')


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
def test_edges_are_as_far_apart_as_the_corridor_is_wide_in_any_plane(axis, plane):
    """Across the axis as the plane shows it, about its ends, however steep it is."""
    corridor = corridor_along(axis)
    shown = np.array(corridor.ahead)[list(plane)]
    assume(np.linalg.norm(shown) > 1e-3)
    widths = (corridor.half_width_m, corridor.end_half_width_m)
    middles = (corridor.tip_m, corridor.end_m)
    for one, other, width, middle in zip(*corridor.edges(*plane), widths, middles, strict=True):
        assert np.linalg.norm(np.subtract(one, other)) == pytest.approx(2.0 * width)
        assert np.subtract(one, other) @ shown == pytest.approx(0.0, abs=1e-9)
        assert np.add(one, other) / 2.0 == pytest.approx(np.array(middle)[list(plane)], abs=1e-9)
    upright = corridor_along([float(i not in plane) for i in range(3)])
    assert upright.edges(*plane) == []


def test_between_ticks_a_path_is_as_deep_as_where_it_is_nearest():
    path = np.array([(-1.0, 4.5, 0.0, 2.0, 0.0, 0.0), (1.0, 4.5, 0.0, 2.0, 0.0, 0.0)])
    assert Zone(5.0).deepest_m(path, 1.0) == pytest.approx(0.5, abs=1e-12)
    assert Zone().deepest_m(path, 1.0) == 0.0


def test_what_is_inside_a_zone():
    """The corridor leads in; across the port, and behind the target, nobody is in it."""
    zone = Zone(10.0, Cone((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 0.2, 19.0))
    clear = np.array([(0.0, 5.0, 0.0), (0.5, 5.0, 0.0), (0.0, 11.0, 9.0), (0.0, 0.5, 0.0)])
    inside = np.array([(0.0, -5.0, 0.0), (1.0, 5.0, 0.0), (0.5, 0.5, 0.0)])
    assert not zone.depths_m(clear).any() and zone.depths_m(inside).all()
    assert not Zone().depths_m(np.vstack([clear, inside])).any()


@given(st.floats(-3.0, 3.0), st.floats(0.0, 9.0), st.floats(-3.0, 3.0))
def test_a_square_corridor_has_four_planes_and_a_round_one_a_cone(across, along, other):
    for square, off in ((True, max(abs(across), abs(other))), (False, math.hypot(across, other))):
        way = Cone((0.0, -1.0, 0.0), (0.0, -1.0, 0.0), 0.2, 9.0, 0.1, square)
        found = way.outside_m((across, -1.0 - along, other))
        assert found == pytest.approx(off - 0.1 - 0.2 * along, abs=1e-12)
        assert (way.end_m, way.end_half_width_m) == ((0.0, -10.0, 0.0), pytest.approx(1.9))
