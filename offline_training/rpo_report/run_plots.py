# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a flight and of a plan, and how a flight passes what is drawn around the target."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight
from rpo_core.control.controller import FuzzyController
from rpo_core.judge import metrics
from rpo_core.judge.zones import Cone, Zone
from rpo_ctrl.explain import AXES
from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import Checked
from rpo_judge.evaluation.plan_bound import Bound
from rpo_log.show import style
from rpo_log.show.report import by_axis, limit_lines
from rpo_montecarlo import outputs
from rpo_report.surface_plots import draw_force, force_bar

Floats = NDArray[np.float64]

CORRIDOR_HALF_ANGLE_DEG = 15.0
KEEP_OUT_RADIUS_M = 5.0

AT_PORT_M = 0.1
"""So near to the tip of the corridor the chaser is at the port, and no zone holds."""

_TURN = np.linspace(0.0, 2.0 * np.pi, 49)


def circle(radius_m: float) -> Floats:
    """Return the outline (n, 2) of a sphere about the target in any plane through it."""
    return radius_m * np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def great_circles(radius_m: float) -> list[Floats]:
    """Return three great circles (3, n) of a sphere about the target."""
    lines = []
    for normal in range(3):
        line = np.zeros((3, len(_TURN)))
        line[[i for i in range(3) if i != normal]] = circle(radius_m).T
        lines.append(line)
    return lines


@dataclass(frozen=True)
class Aids:
    """A cone with its apex in the target, and a sphere around it, where a scenario has no zones.

    axis : 0, 1, 2 of LVLH; sign : the side of the target on which the cone lies
    length_m : of the cone
    """

    axis: int
    sign: float
    length_m: float

    @classmethod
    def of(cls, flight: Flight) -> Aids:
        """Return the aids of a flight."""
        start = flight.positions_m[0]
        axis = int(np.abs(start).argmax())
        return cls(axis, -1.0 if start[axis] < 0.0 else 1.0, float(np.abs(start).max()) * 1.1)

    @property
    def zones(self) -> Zone:
        """The aids as they are drawn."""
        ahead = tuple(self.sign if i == self.axis else 0.0 for i in range(3))
        slope = float(np.tan(np.deg2rad(CORRIDOR_HALF_ANGLE_DEG)))
        cone = Cone((0.0, 0.0, 0.0), ahead, slope, self.length_m)
        return Zone(KEEP_OUT_RADIUS_M, cone)

    def off_axis_deg(self, positions_m: Floats) -> Floats:
        """Return the angles (n,) between positions (n, 3) and the corridor's axis."""
        along = self.sign * positions_m[:, self.axis]
        across = np.linalg.norm(np.delete(positions_m, self.axis, axis=1), axis=1)
        return np.rad2deg(np.arctan2(across, along))


def passage(flight: Flight, aids: Aids) -> list[tuple[str, str]]:
    """Return names and values: how a flight passes the aids."""
    times, distance = flight.scenario.times_s, np.linalg.norm(flight.positions_m, axis=1)
    found = [
        ('distance at the start', f'{distance[0]:.4g} m'),
        (
            f"off the corridor's axis {AXES[aids.axis]} at the start",
            f'{aids.off_axis_deg(flight.positions_m[:1])[0]:.1f}°',
        ),
    ]
    inside = np.flatnonzero(distance <= KEEP_OUT_RADIUS_M)
    if not inside.size:
        return [*found, (f'within {KEEP_OUT_RADIUS_M:g} m of the target', 'never')]
    entry = int(inside[0])
    where = slice(entry, entry + 1)
    return [
        *found,
        (f'enters the keep-out sphere of {KEEP_OUT_RADIUS_M:g} m at', f'{times[entry]:.1f} s'),
        ('closing speed at the entry', f'{_closing_m_s(flight, entry):.3g} m/s'),
        (
            "off the corridor's axis at the entry",
            f'{aids.off_axis_deg(flight.positions_m[where])[0]:.1f}°',
        ),
    ]


def _closing_m_s(flight: Flight, tick: int) -> float:
    position, velocity = flight.positions_m[tick], flight.velocities_m_s[tick]
    range_m = np.linalg.norm(position)
    closing = np.vdot(position, velocity) / range_m if range_m else np.linalg.norm(velocity)
    return float(-closing)


def zone_passage(flight: Flight, zones: Zone) -> list[tuple[str, str]]:
    """Return names and values: how a flight passes zones of its scenario, at its ticks.

    It ends where the chaser is at the port.
    """
    until = len(flight.states)
    if zones.corridor is not None:
        away = np.linalg.norm(flight.positions_m - np.array(zones.corridor.tip_m), axis=1)
        until = int(np.argmax(away <= AT_PORT_M)) if (away <= AT_PORT_M).any() else until
    distance = np.linalg.norm(flight.positions_m[:until], axis=1)
    before = ' before the port' if until < len(flight.states) else ''
    found = [(f'least distance to the target{before}', f'{distance.min():.4g} m')]
    if not zones.keep_out_m:
        return found
    name = f'the keep-out sphere of {zones.keep_out_m:g} m'
    outside = zones.depths_m(flight.positions_m[:until]) > 0.0
    where = ' outside the corridor' if zones.corridor is not None else ''
    broken = f'{outside.sum()} of {len(outside)}' if outside.any() else 'none'
    found.append((f'ticks in {name}{where}', broken))
    inside = np.flatnonzero(distance < zones.keep_out_m)
    if not inside.size:
        return [*found, (f'enters {name}', 'never')]
    entry = int(inside[0])
    found += [
        (f'enters {name} at', f'{flight.scenario.times_s[entry]:.1f} s'),
        ('closing speed at the entry', f'{_closing_m_s(flight, entry):.3g} m/s'),
    ]
    if zones.corridor is not None:
        positions = map(tuple, flight.positions_m[inside].tolist())
        room = -max(map(zones.corridor.outside_m, positions))
        found.append(("least distance to the corridor's wall inside of it", f'{room:.3g} m'))
    return found


_INK, _OPTIMUM = style.LIGHT['ink'], style.LIGHT['optimum']
MARK_S = 20.0
_LINES = ('-', (0, (5, 2)))
OptimaByName = dict[str, Flight]
_LEAST_SHARE = 0.3
"""Least size of the picture in space along an axis, of its largest: its numbers need room."""
_WALL = {'color': style.LIGHT['muted'], 'linewidth': 0.8}
_SPHERE = {'color': style.LIGHT['z'], 'linewidth': 1.0}
_POINT = {'markerfacecolor': 'none', 'markeredgecolor': style.LIGHT['muted'], 'markersize': 6}


class Drawn(NamedTuple):
    """What is drawn around the target.

    note : ' (aid)' where it is none of the scenario's
    """

    zones: Sequence[Zone]
    note: str = ''


def approach(flight: Flight, optima: OptimaByName, drawn: Drawn) -> Any:
    """Return the flight in space and in two planes, with what is drawn around the target."""
    figure = style.new_figure(7.9)
    grid = figure.add_gridspec(2, 2, height_ratios=(9, 8))
    room, space = figure.add_subplot(grid[0, :]), figure.add_axes((0, 0, 1, 1), projection='3d')
    room.set_axis_off()
    space.set_in_layout(False)
    planes = [figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])]
    _in_space(space, flight, optima, drawn)
    for axes, across, label in zip(
        planes, (0, 2), ('x, R-bar outward [m]', 'z, H-bar [m]'), strict=True
    ):
        _in_plane(axes, flight, optima, drawn, across)
        axes.set(xlabel='y, V-bar [m]', ylabel=label)
    style.legend_below(figure, planes[0], columns=4)
    _fit(figure, space, room)
    return figure


def _fit(figure: Any, space: Any, room: Any) -> None:
    """Give axes in space the size at which they and their labels fill their room.

    The layout of matplotlib does not know how much of a cube's square a view leaves empty.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine('none')
    target, size = room.get_window_extent(), figure.bbox.size
    for _ in range(3):  # labels do not grow along
        shown, square = _extent(space), space.get_window_extent()
        scale = float((target.size / shown.size).min())
        corner = (target.min + target.max) / 2 - scale * ((shown.min + shown.max) / 2 - square.min)
        space.set_position((*(corner / size), *(scale * square.size / size)))
        figure.draw_without_rendering()


def _extent(space: Any) -> Any:
    """Return the box around the cube of axes in space and its labels, after a drawing [pixels]."""
    from matplotlib.transforms import Bbox

    limits = (space.get_xlim3d(), space.get_ylim3d(), space.get_zlim3d())
    corners = np.array(list(itertools.product(*limits, [1.0])))  # homogeneous
    projected = corners @ space.get_proj().T
    cube = Bbox.null()
    cube.update_from_data_xy(space.transData.transform(projected[:, :2] / projected[:, 3:]))
    labels = [axis.get_tightbbox() for axis in (space.xaxis, space.yaxis, space.zaxis)]
    return Bbox.union([cube, *labels])


def _paths(flight: Flight, optima: OptimaByName) -> list[tuple[str, Floats, str, Any]]:
    """Return name, positions (n, 3), colour and line style, the flight last, on top."""
    lines = [
        (name, optimum.positions_m, _OPTIMUM, line)
        for (name, optimum), line in zip(optima.items(), _LINES, strict=False)
    ]
    return [*lines, ('this flight', flight.positions_m, _INK, '-')]


def _marked(flight: Flight) -> slice:
    """Return the ticks every 20 s; their positions lie close together where it is slow."""
    return slice(None, None, max(1, round(MARK_S / flight.scenario.dt_s)))


def draw_zones(axes: Any, drawn: Drawn, across: int) -> None:
    """Draw zones in the plane of V-bar and another axis of LVLH."""
    for zones in drawn.zones:
        if zones.corridor is not None:
            for edge in zones.corridor.edges(1, across):
                axes.plot(*zip(*edge, strict=True), **_WALL, label=f'corridor{drawn.note}')
        if zones.keep_out_m:
            outline = circle(zones.keep_out_m).T
            axes.plot(*outline, **_SPHERE, label=f'keep-out sphere{drawn.note}')
        points = np.array(list(zones.points_m.values())).reshape(-1, 3)
        if len(points):
            axes.plot(*points[:, [1, across]].T, 'D', **_POINT, label='holds, retreat')


def _in_plane(axes: Any, flight: Flight, optima: OptimaByName, drawn: Drawn, across: int) -> None:
    draw_zones(axes, drawn, across)
    for name, positions, colour, line in _paths(flight, optima):
        axes.plot(positions[:, 1], positions[:, across], color=colour, linestyle=line, label=name)
    marks = flight.positions_m[_marked(flight)]
    label = f'every {MARK_S:g} s'
    axes.plot(marks[:, 1], marks[:, across], 'o', color=_INK, markersize=3.5, label=label)
    axes.plot(0.0, 0.0, '+', color=_INK, markersize=10, label='target')
    if flight.scenario.goal is not None:
        goal_m = flight.scenario.goal_position_m
        axes.plot(goal_m[1], goal_m[across], 'x', color=_INK, markersize=8, label='goal')
    axes.set_aspect('equal', adjustable='datalim')


def reach_m(drawn: Drawn) -> float:
    """Return the range that the picture of the zones from near shows."""
    ends = [zones.corridor.end_m for zones in drawn.zones if zones.corridor is not None]
    reaches = [zones.keep_out_m for zones in drawn.zones]
    return 1.15 * max([*reaches, *(float(np.linalg.norm(end)) for end in ends)])


def near(flight: Flight, drawn: Drawn) -> Any:
    """Return the zones from near, in two planes, with the flight in them."""
    figure, panels = style.new_panels(4.6, 1, 2)
    reach = reach_m(drawn)
    for axes, across, label in zip(
        panels, (0, 2), ('x, R-bar outward [m]', 'z, H-bar [m]'), strict=True
    ):
        _in_plane(axes, flight, {}, drawn, across)
        axes.set_aspect('equal', adjustable='box')
        around = (-reach, reach)
        axes.set(xlabel='y, V-bar [m]', ylabel=label, xlim=around, ylim=around)
    style.legend_below(figure, panels[0], columns=4)
    return figure


def _in_space(axes: Any, flight: Flight, optima: OptimaByName, drawn: Drawn) -> None:
    for zones in drawn.zones:
        for line in zones.corridor.lines() if zones.corridor is not None else ():
            x, y, z = np.array(line).T
            axes.plot(y, z, x, color=_WALL['color'], linewidth=0.5)
        for x, y, z in great_circles(zones.keep_out_m) if zones.keep_out_m else ():
            axes.plot(y, z, x, color=_SPHERE['color'], linewidth=0.5)
    for _, positions, colour, line in _paths(flight, optima):
        x, y, z = positions.T
        axes.plot(y, z, x, color=colour, linestyle=line)
    x, y, z = flight.positions_m[_marked(flight)].T
    axes.plot(y, z, x, 'o', color=_INK, markersize=3)
    axes.plot([0.0], [0.0], [0.0], '+', color=_INK, markersize=10)
    axes.set_xlabel('y, V-bar [m]', labelpad=9)
    axes.set_ylabel('z, H-bar [m]', labelpad=9)
    axes.set_zlabel('x, R-bar [m]', labelpad=5)
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    least = _LEAST_SHARE * np.ptp(limits, axis=1).max()
    middles = limits.mean(axis=1, keepdims=True)
    half = np.maximum(np.ptp(limits, axis=1, keepdims=True), least) / 2.0
    for set_limits, one in zip(
        (axes.set_xlim, axes.set_ylim, axes.set_zlim), middles + half * [-1.0, 1.0], strict=True
    ):
        set_limits(*one)
    axes.set_box_aspect(2.0 * half.ravel())
    axes.locator_params(nbins=5)
    axes.view_init(elev=22.0, azim=-58.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.0, 0.0, 0.0, 0.0))
        axis.line.set_color(style.LIGHT['muted'])


def energy(flight: Flight, optima: OptimaByName) -> Any:
    """Return J over time, beside the optima."""
    figure, axes = style.new_panels(3.4)
    for (name, optimum), line in zip(optima.items(), _LINES, strict=False):
        axes.plot(*_energy(optimum), color=_OPTIMUM, linestyle=line, label=name)
    axes.plot(*_energy(flight), color=_INK, label='this flight')
    axes.set(xlabel='time [s]', ylabel='energy J so far [N²s]', ylim=(0.0, None))
    axes.margins(x=0.01)
    style.legend_below(figure, axes)
    return figure


def _energy(flight: Flight) -> tuple[Floats, Floats]:
    spent = np.cumsum((flight.saturated_forces_n**2).sum(axis=1)) * flight.scenario.dt_s
    return flight.scenario.times_s, np.concatenate([[0.0], spent])


def limits(flight: Flight) -> Any:
    """Return force and slew against what the thrusters and the requirements allow."""
    scenario, forces = flight.scenario, flight.saturated_forces_n
    first, always = metrics.first_slew_tick(scenario), (0.0, scenario.duration_s)
    slew = np.diff(forces[first - 1 :], axis=0) / scenario.dt_s
    figure, (upper, lower) = style.new_panels(4.6, 2, sharex=True)
    by_axis(upper, scenario.times_s[:-1], forces, 'force [N]')
    limit_lines(upper, scenario.max_force_n, 'limit', always)
    by_axis(lower, scenario.times_s[first:-1], slew, 'slew df/dt [N/s]', linewidth=0.8)
    required = scenario.requirements
    if required is not None and required.slew_per_axis_n_s is not None:
        limit_lines(lower, required.slew_per_axis_n_s, 'limit', always)
    lower.set_xlabel('time [s]')
    style.legend_below(figure, upper)
    return figure


def pulses(flight: Flight) -> Any:
    """Return what the thrusters exert, what they owe the command, and the propellant spent."""
    scenario, thrust = flight.scenario, flight.thrust
    times_s = scenario.times_s[:-1]
    owed = np.cumsum(flight.saturated_forces_n - thrust.forces_n, axis=0) * scenario.dt_s
    figure, (upper, middle, lower) = style.new_panels(6.4, 3, sharex=True)
    by_axis(upper, times_s, thrust.forces_n, 'force exerted [N]', linewidth=0.6)
    by_axis(middle, times_s, 1e3 * owed, 'impulse owed [mN s]', linewidth=0.8)
    spent_g = 1e3 * (scenario.mass_kg - thrust.masses_kg)
    lower.plot(times_s, spent_g, color=style.LIGHT['ink'])
    lower.set(xlabel='time [s]', ylabel='propellant [g]')
    style.legend_below(figure, upper)
    return figure


def disturbance(flight: Flight) -> Any:
    """Return the disturbance, and what control leaves of it."""
    scenario, disturbances = flight.scenario, flight.disturbances_n[:-1]
    level = metrics.disturbance_level_n(flight)
    figure, (upper, lower) = style.new_panels(4.6, 2, sharex=True)
    by_axis(upper, scenario.times_s[:-1], disturbances, 'disturbance [N]')
    by_axis(lower, scenario.times_s[:-1], flight.saturated_forces_n + disturbances, 'net force [N]')
    limit_lines(lower, level, 'level of the disturbance', (0.0, scenario.duration_s))
    lower.set(xlabel='time [s]', ylim=(-3.0 * level, 3.0 * level))
    style.legend_below(figure, lower)
    return figure


def closing(flight: Flight) -> Any:
    """Return the closing speed over the range; the chaser comes in from the left."""
    ranges = np.linalg.norm(flight.errors[:, :3], axis=1)
    speeds = metrics.closing_speeds_m_s(flight)
    figure, axes = style.new_panels(3.4)
    axes.plot(ranges, speeds, color=_INK, label='this flight')
    axes.plot(ranges[0], speeds[0], 'o', color=_INK, markersize=6, label='start')
    dots = _marked(flight)
    axes.plot(
        ranges[dots], speeds[dots], 'o', color=_INK, markersize=3, label=f'every {MARK_S:g} s'
    )
    axes.set(
        xlabel='range from the goal [m]',
        ylabel='closing speed [m/s]',
        xlim=(1.05 * max(ranges.max(), 1e-3), 0.0),
    )
    style.legend_below(figure, axes)
    return figure


def phase_planes(flight: Flight, errors: Floats, controller: FuzzyController | None) -> Any:
    """Return velocity over position per axis, on the force that a controller answers with.

    errors : (n, 6) true states relative to what the controller flies to [m, m/s]
    """
    figure, panels = style.new_panels(3.9, 1, 3)
    spans = [1.08 * np.maximum(np.abs(v).max(axis=0), 1e-3) for v in (errors[:, :3], errors[:, 3:])]
    image = None
    for i, (axes, name) in enumerate(zip(panels, style.AXIS_NAMES, strict=True)):
        position, velocity = errors[:, i], errors[:, 3 + i]
        if controller is not None:
            image = draw_force(axes, controller, (spans[0][i], spans[1][i]))
        axes.plot(position, velocity, color=_INK, label='this flight')
        axes.plot(position[0], velocity[0], 'o', color=_INK, markersize=6, label='start')
        dots, label = _marked(flight), f'every {MARK_S:g} s'
        axes.plot(position[dots], velocity[dots], 'o', color=_INK, markersize=3, label=label)
        axes.set(title=name, xlabel='position [m]')
    panels[0].set_ylabel('velocity [m/s]')
    if image is not None:
        force_bar(figure, image, panels)
    style.legend_below(figure, panels[0])
    return figure


def draw(found: Checked, bound: Bound, settings: Guidance, path: Path) -> None:
    """Write the picture; matplotlib must be there."""
    with style.applied():
        figure, (left, right) = style.new_panels(5.0, 1, 2)
        states = np.array(found.references)
        for axes, (across, label) in zip(
            (left, right), ((0, 'x, R-bar [m]'), (2, 'z, H-bar [m]')), strict=True
        ):
            draw_zones(axes, Drawn([settings.zones(None)]), across)
            axes.plot(
                bound.positions_m[:, 1], bound.positions_m[:, across], '--',
                color=style.LIGHT['y'], label='best path found',
            )  # fmt: skip
            axes.plot(states[:, 1], states[:, across], color=style.LIGHT['ink'], label='plan')
            for change in found.changes:
                axes.plot(*states[change.tick, [1, across]], 'o', color=style.LIGHT['ink'])
            axes.set(xlabel='y, V-bar [m]', ylabel=label)
            axes.set_aspect('equal', adjustable='datalim')
        left.legend(loc='best')
        figure.suptitle(f'J = {bound.plan:.3f} N²s; best path found {bound.best:.3f} N²s')
        with outputs.writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path)
