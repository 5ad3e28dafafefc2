# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a flight, a plan and a control surface, and how a flight passes the zones."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rpo.analysis.turned import in_lvlh
from rpo.proof import surface
from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.guidance.guidance import Guidance, Rehearsal
from rpo_core.judge import metrics
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire.interfaces import EXERTED_TORQUE
from rpo_core.world.zones import Zone
from rpo_log.show import style
from rpo_log.show.report import by_axis, force_label, legend_names, limit_lines

_POINTS = 141
_COARSE = 61
_REACH_M, _REACH_M_S = 100.0, 1.0


def draw_force(axes: Any, controller: FuzzyController, spans: tuple[float, float]) -> Any:
    """Draw the force [N] over +- spans of position [m] and velocity [m/s]; return the contours."""
    position_scale, velocity_scale, force_scale = controller.scales
    r, v = (np.linspace(-span, span, _POINTS) for span in spans)
    e, w = np.meshgrid(
        np.clip(-r / position_scale, -1.0, 1.0), np.clip(-v / velocity_scale, -1.0, 1.0)
    )
    force = force_scale * surface.values(controller.system, e.ravel(), w.ravel()).reshape(e.shape)
    # The largest of a coarse grid that has the corners of the surface.
    coarse = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41))
    peak = float(np.abs(surface.values(controller.system, *map(np.ravel, coarse))).max())
    return _contours(axes, (r, v), force, force_scale * peak)


def _contours(axes: Any, grid: tuple[Floats, Floats], force: Floats, peak: float) -> Any:
    from matplotlib.colors import ListedColormap

    levels = np.linspace(-peak, peak, style.SHADES + 1)
    inside = np.clip(force, -peak, peak)  # the peak is that of a coarser grid; beyond it: holes
    image = axes.contourf(*grid, inside, levels, cmap=ListedColormap(style.SCALE), extend='neither')
    image.set_edgecolor('face')  # closes the hairlines between neighbouring shades
    image.set_linewidth(0.4)
    axes.grid(False)
    return image


def axis_forces(controller: AnyController) -> Any:
    """Return each axis's force over its position and velocity, the others at rest, at t = 0."""
    r, v = (np.linspace(-span, span, _COARSE) for span in (_REACH_M, _REACH_M_S))
    forces = np.empty((3, _COARSE, _COARSE))
    stage = controller.stage(getattr(controller, 'clock_s', None) or 1.0)
    for axis, row, column in itertools.product(range(3), range(_COARSE), range(_COARSE)):
        position, velocity = np.zeros(3), np.zeros(3)
        position[axis], velocity[axis] = r[column], v[row]
        (force,) = stage.step(0, (*position.tolist(), *velocity.tolist()))
        forces[axis, row, column] = force[axis]
    figure, panels = style.new_panels(3.9, 1, 3, sharey=True)
    peak = float(np.abs(forces).max()) or 1.0
    for axes, name, values in zip(panels, style.AXIS_NAMES, forces, strict=True):
        image = _contours(axes, (r, v), values, peak)
        axes.set(title=name, xlabel='position [m]', xticks=(-_REACH_M / 2, 0.0, _REACH_M / 2))
    panels[0].set_ylabel('velocity [m/s]')
    force_bar(figure, image, panels)
    return figure


def force_bar(figure: Any, image: Any, axes: Any) -> None:
    """Draw the scale of forces beside some axes."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(image, ax=axes, label='force [N]', ticks=MaxNLocator(7, symmetric=True))
    bar.ax.grid(False)
    bar.outline.set_edgecolor(style.LIGHT['muted'])


AT_PORT_M = 0.1
"""So near to the tip of the corridor the chaser is at the port, and no zone holds."""

_TURN = np.linspace(0.0, 2.0 * np.pi, 49)


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
    rows = [(f'least distance to the target{before}', f'{distance.min():.4g} m')]
    if not zones.keep_out_m:
        return rows
    name = f'the keep-out sphere of {zones.keep_out_m:g} m'
    outside = zones.depths_m(flight.positions_m[:until]) > 0.0
    where = ' outside the corridor' if zones.corridor is not None else ''
    broken = f'{outside.sum()} of {len(outside)}' if outside.any() else 'none'
    rows.append((f'ticks in {name}{where}', broken))
    inside = np.flatnonzero(distance < zones.keep_out_m)
    if not inside.size:
        return [*rows, (f'enters {name}', 'never')]
    entry = int(inside[0])
    position, velocity = flight.positions_m[entry], flight.velocities_m_s[entry]
    range_m = np.linalg.norm(position)
    opening = np.vdot(position, velocity) / range_m if range_m else np.linalg.norm(velocity)
    rows += [
        (f'enters {name} at', f'{flight.scenario.times_s[entry]:.1f} s'),
        ('closing speed at the entry', f'{-opening:.3g} m/s'),
    ]
    if zones.corridor is not None:
        positions = map(tuple, flight.positions_m[inside].tolist())
        room = -max(map(zones.corridor.outside_m, positions))
        rows.append(("least distance to the corridor's wall inside of it", f'{room:.3g} m'))
    return rows


_INK, _OPTIMUM = style.LIGHT['ink'], style.LIGHT['optimum']
MARK_S = 20.0
_OTHERS = (_OPTIMUM, *style.AXES)
_LINES = ('-', (0, (5, 2)))
FLOWN = 'this flight'
FlightsByName = dict[str, Flight]
_WALL = {'color': style.LIGHT['muted'], 'linewidth': 0.8}
_SPHERE = {'color': style.LIGHT['z'], 'linewidth': 1.0}
_POINT = {'markerfacecolor': 'none', 'markeredgecolor': style.LIGHT['muted'], 'markersize': 6}


LVLH_NAMES = ('x, R-bar outward', 'y, V-bar', 'z, H-bar')


def axis_names(scenario: Scenario) -> tuple[str, ...]:
    """Return what the axes of pictures of zones are: of LVLH, or of a target that turns."""
    return LVLH_NAMES if scenario.target is None else tuple(f'{a} of the target' for a in 'xyz')


def approach(
    flight: Flight, others: FlightsByName, zones: Sequence[Zone], name: str = FLOWN
) -> Any:
    """Return the flight in two planes beside others, with the zones about the target."""
    figure, panels = style.new_panels(4.0, 1, 2)
    names = axis_names(flight.scenario)
    for axes, across in zip(panels, (0, 2), strict=True):
        _in_plane(axes, flight, others, zones, across, name)
        axes.set(xlabel=f'{names[1]} [m]', ylabel=f'{names[across]} [m]')
    style.legend_below(figure, panels[0], columns=4)
    return figure


def _paths(flight: Flight, others: FlightsByName, name: str) -> Iterator[tuple[str, Flight, Any]]:
    """Yield name, flight and how it is drawn, the flight last, on top.

    A legend leaves out a label that begins with `_`, so a space comes before it.
    """
    looks = itertools.product(_LINES, _OTHERS)
    for (other, beside), (line, colour) in zip(others.items(), looks, strict=False):
        yield ' ' * (other[:1] == '_') + other, beside, {'color': colour, 'linestyle': line}
    yield ' ' * (name[:1] == '_') + name, flight, {'color': _INK}


def _marked(flight: Flight) -> slice:
    """Return the ticks every 20 s; their positions lie close together where it is slow."""
    return slice(None, None, max(1, round(MARK_S / flight.scenario.dt_s)))


def draw_zones(axes: Any, zones: Sequence[Zone], across: int) -> None:
    """Draw zones in the plane of V-bar and another axis of LVLH."""
    for zone in zones:
        if zone.corridor is not None:
            for edge in zone.corridor.edges(1, across):
                axes.plot(*zip(*edge, strict=True), **_WALL, label='corridor')
        if zone.keep_out_m:
            x, y = zone.keep_out_m * np.cos(_TURN), zone.keep_out_m * np.sin(_TURN)
            axes.plot(x, y, **_SPHERE, label='keep-out sphere')
        points = np.array(list(zone.points_m.values())).reshape(-1, 3)
        if len(points):
            axes.plot(*points[:, [1, across]].T, 'D', **_POINT, label='holds, retreat')


def _in_plane(
    axes: Any, flight: Flight, others: FlightsByName, zones: Sequence[Zone], across: int, name: str
) -> None:
    draw_zones(axes, zones, across)
    for label, shown, look in _paths(flight, others, name):
        axes.plot(*shown.positions_m[:, [1, across]].T, label=label, **look)
    marks = flight.positions_m[_marked(flight)]
    label = f'every {MARK_S:g} s'
    axes.plot(marks[:, 1], marks[:, across], 'o', color=_INK, markersize=3.5, label=label)
    axes.plot(0.0, 0.0, '+', color=_INK, markersize=10, label='target')
    if flight.scenario.goal is not None:
        goal_m = flight.scenario.goal_position_m
        axes.plot(goal_m[1], goal_m[across], 'x', color=_INK, markersize=8, label='goal')
    axes.set_aspect('equal', adjustable='datalim')


def reach_m(zones: Sequence[Zone]) -> float:
    """Return the range that the picture of the zones from near shows."""
    ends = [zone.corridor.end_m for zone in zones if zone.corridor is not None]
    reaches = [zone.keep_out_m for zone in zones]
    return 1.15 * max([*reaches, *(float(np.linalg.norm(end)) for end in ends)])


def near(flight: Flight, zones: Sequence[Zone]) -> Any:
    """Return the zones from near, in two planes, with the flight in them."""
    figure = approach(flight, {}, zones)
    around = (-reach_m(zones), reach_m(zones))
    for axes in figure.axes:
        axes.set_aspect('equal', adjustable='box')
        axes.set(xlim=around, ylim=around)
    return figure


def energy(flight: Flight, others: FlightsByName, name: str = FLOWN) -> Any:
    """Return J over time, beside other flights."""
    figure, axes = style.new_panels(3.0)
    for label, shown, look in _paths(flight, others, name):
        spent = np.cumsum((shown.saturated_forces_n**2).sum(axis=1)) * shown.scenario.dt_s
        axes.plot(shown.scenario.times_s, [0.0, *spent], label=label, **look)
    axes.set(xlabel='time [s]', ylabel='energy J so far [N²s]', ylim=(0.0, None))
    axes.margins(x=0.01)
    style.legend_below(figure, axes, columns=4)
    return figure


def limits(flight: Flight) -> Any:
    """Return force and slew against what the thrusters and the requirements allow."""
    scenario, forces = flight.scenario, flight.saturated_forces_n
    first, always = metrics.first_slew_tick(scenario), (0.0, scenario.duration_s)
    slew = np.diff(forces[first - 1 :], axis=0) / scenario.dt_s
    figure, (upper, lower) = style.new_panels(4.0, 2, sharex=True)
    names = legend_names(scenario)
    by_axis(upper, scenario.times_s[:-1], forces, force_label(scenario), names=names)
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
    owed_n = in_lvlh(flight, flight.saturated_forces_n) - thrust.forces_n
    owed = np.cumsum(owed_n, axis=0) * scenario.dt_s
    torques = flight.signals.get(EXERTED_TORQUE) if scenario.thrusters.table else None
    panels = 2 + (torques is not None) + bool(scenario.thrusters.propellant)
    figure, (upper, middle, *more) = style.new_panels(0.4 + 2.0 * panels, panels, sharex=True)
    by_axis(upper, times_s, thrust.forces_n, 'force exerted [N]', linewidth=0.6)
    by_axis(middle, times_s, 1e3 * owed, 'impulse owed [mN s]', linewidth=0.8)
    if torques is not None:
        by_axis(more[0], times_s, torques[:-1], "torque [N m],\nchaser's axes", linewidth=0.6)
    if scenario.thrusters.propellant:
        spent_g = 1e3 * (scenario.mass_kg - thrust.masses_kg)
        by_axis(more[-1], times_s, spent_g, 'propellant [g]')
    (more or [middle])[-1].set_xlabel('time [s]')
    style.legend_below(figure, upper)
    return figure


def disturbance(flight: Flight) -> Any:
    """Return the disturbance over time."""
    figure, axes = style.new_panels(2.8)
    by_axis(axes, flight.scenario.times_s[:-1], flight.disturbances_n[:-1], 'disturbance [N]')
    axes.set_xlabel('time [s]')
    style.legend_below(figure, axes)
    return figure


def _trace(axes: Any, flight: Flight, x: Floats, y: Floats) -> None:
    """Draw a flight in a plane, with its start and dots as time goes by."""
    dots, label = _marked(flight), f'every {MARK_S:g} s'
    axes.plot(x, y, color=_INK, label=FLOWN)
    axes.plot(x[0], y[0], 'o', color=_INK, markersize=6, label='start')
    axes.plot(x[dots], y[dots], 'o', color=_INK, markersize=3, label=label)


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
        _trace(axes, flight, position, velocity)
        axes.set(title=name, xlabel='position [m]')
    panels[0].set_ylabel('velocity [m/s]')
    if image is not None:
        force_bar(figure, image, panels)
    style.legend_below(figure, panels[0])
    return figure


def draw(flown: Rehearsal, energy_n2s: float, settings: Guidance, scenario: Scenario) -> Any:
    """Return the picture of a plan."""
    figure, (left, right) = style.new_panels(5.0, 1, 2)
    states, names = scenario.seen(np.array(flown.references)), axis_names(scenario)
    for axes, across in ((left, 0), (right, 2)):
        draw_zones(axes, [settings.zones(scenario)], across)
        axes.plot(states[:, 1], states[:, across], color=style.LIGHT['ink'], label='plan')
        for change in flown.changes:
            axes.plot(*states[change.tick, [1, across]], 'o', color=style.LIGHT['ink'])
        axes.set(xlabel=f'{names[1]} [m]', ylabel=f'{names[across]} [m]')
        axes.set_aspect('equal', adjustable='datalim')
    left.legend(loc='best')
    figure.suptitle(f'J = {energy_n2s:.3f} N²s')
    return figure
