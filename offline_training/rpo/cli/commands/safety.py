# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo safety`: the constants of runtime assurance, attacks on it, and how often it acts."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import Controller, NoFail, Set, end, interruptible
from rpo.display import print_table, progress
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo.montecarlo.config import Campaign

safety = typer.Typer(
    name='safety',
    help='Runtime assurance: its constants, attacks on it, and how often it acts.',
    no_args_is_help=True,
)

LEGEND = (
    'Ticks with a path in the zone, without an admissible command, above the speed limit, and with '
    'a changed command; nearest: the least distance of a path to the zone.'
)

Name = Annotated[str, Argument(help='shipped scenario, or file', metavar='SCENARIO')]
Flights = Annotated[str, Argument(help='shipped scenario or set, or file', metavar='SCENARIO')]
Controllers = Annotated[list[str] | None, Option(help='shipped name or file; repeatable')]


@safety.command()
def show(scenario: Name, changes: Set = None) -> None:
    """Print the constants of the proof for a scenario (docs/safety.md)."""
    from rpo_core.assurance.guard import proof_of
    from rpo_core.assurance.settings import Assurance
    from rpo_core.scenario import overrides

    found = overrides.load(scenario, changes or [])
    settings = found.section(Assurance)
    if settings is None:
        raise InputError(f'scenario {found.name} must have a section `assurance`; it has none')
    proof = proof_of(settings, found)
    guard = proof.guard._asdict()
    constants = {**proof.errors._asdict(), **guard, 'floor_m_s': proof.floor_m_s}
    rows = list(constants.items())
    if proof.walls is not None:  # what differs in the corridor, in the axes of the target
        walls = proof.walls._asdict().items()
        rows += [(f'turning {name}', value) for name, value in walls if value != guard[name]]
    cells = [(name, f'{value:.6g}') for name, value in rows]
    print_table(('constant', 'value'), cells, f'{found.name}: what is assumed, and what follows')


@safety.command()
def attack(
    scenario: Name = 'assured',
    runs: Annotated[int, Option(min=1, max=10_000_000, help='flights')] = 7000,
    seed: Annotated[int, Option(min=0, help='of all that is drawn')] = 1,
    ticks: Annotated[int, Option(min=1, max=1_000_000, help='length of a flight')] = 1000,
    campaign: Annotated[str, Option(help='name or file: fly its runs, with all stages')] = '',
    estimated: Annotated[bool, Option('--estimated', help='with its own sensors')] = False,
    changes: Set = None,
    no_fail: NoFail = False,
) -> None:
    """Fly dispersed runs under hostile commands and faults; exit code 1 if a limit is broken.

    Starts, errors of navigation, disturbance and thrust are at the edge of what the section
    `assurance` assumes. The path is looked at between the ticks, too.

    With --campaign, a run has hostile commands from a drawn moment on, and what the campaign
    disperses; it is flown to its end. Its attitude is estimated, and must keep
    `chaser_attitude_error_deg`; its position is known as badly as assurance assumes.
    """
    if campaign:
        from rpo.analysis.attack_campaign import bounded
        from rpo.montecarlo import config

        chosen = config.load(campaign, changes or [], runs=runs, seed=seed)
        end(_attack_campaign(chosen if estimated else bounded(chosen)), no_fail)
        return
    from rpo.analysis import attack as attacks
    from rpo_core.scenario import overrides

    found = overrides.load(scenario, changes or [])
    began = time.monotonic()
    with interruptible(lambda: 'stopped; nothing is kept'), progress() as draw:
        results = attacks.attack(found, runs, seed, ticks, lambda n: draw('runs', n, runs))
    limits = {
        'in the zone': attacks.VIOLATED, 'not admissible': attacks.INFEASIBLE,
        'too fast': attacks.TOO_FAST, 'outside': attacks.OUTSIDE, 'hard': attacks.HARD,
    }  # fmt: skip
    counted = {**limits, 'changed': attacks.ACTED, 'contacts': attacks.CONTACTS}
    rows = []
    for result in results:
        totals = (str(result.total(column)) for column in counted.values())
        nearest = f'{result.least(attacks.LEAST_FREE):.3g} m'
        rows.append((result.kind, str(len(result.rows)), *totals, nearest))
    title = f'{found.name}: {runs} runs of up to {ticks} ticks in {time.monotonic() - began:.0f} s'
    print_table(('command', 'runs', *counted, 'nearest'), rows, title)
    broken = sum(r.total(column) for r in results for column in limits.values())
    typer.echo(LEGEND)
    typer.echo('all limits held' if not broken else f'{broken} ticks break a limit')
    end(broken > 0, no_fail)


def _attack_campaign(chosen: Campaign) -> bool:
    """Fly the runs of a campaign under hostile commands, print them; return whether a limit broke.

    The path is looked at at ticks, until contact.
    """
    import numpy as np

    from rpo.analysis.attack import settings_of
    from rpo.analysis.attack_campaign import attack_campaign

    runs = chosen.config.runs
    began, rows, broken = time.monotonic(), [], 0
    with interruptible(lambda: 'stopped; nothing is kept'), progress() as draw:
        found = attack_campaign(chosen, lambda n: draw('runs', n, runs))
    settings = settings_of(chosen.scenario)
    most_deg, way = settings.chaser_attitude_error_deg or 0.0, settings.corridor
    for one in found:
        touched = np.isfinite(one.closing_m_s)
        hard = np.zeros_like(touched)
        if way is not None:
            fast = one.closing_m_s > way.closing_m_s
            hard = touched & (fast | (one.lateral_m_s > way.lateral_m_s))
        misses = one.depth_m > 0.0, hard, one.turned_deg > most_deg
        counts = [int(some.sum()) for some in misses]
        broken += sum(counts)
        worst = f'{one.turned_deg.max(initial=0.0):.3f} deg'
        rows.append((one.kind, *map(str, (len(hard), *counts, int(touched.sum()))), worst))
    heads = ('command', 'runs', 'in the zone', 'hard', 'turned too far', 'contacts', 'turned')
    title = f'{chosen.config.name}: {runs} runs, hostile from a drawn tick on, in '
    print_table(heads, rows, f'{title}{time.monotonic() - began:.0f} s')
    typer.echo(f'turned: largest angle by which a force was turned wrongly, of {most_deg:g} deg')
    typer.echo('all limits held' if not broken else f'{broken} runs break a limit')
    return broken > 0


@safety.command()
def quiet(
    scenario: Flights = 'paper_training',
    controller: Controllers = None,
    speed: Annotated[str, Option(help='preset of the speed limit')] = 'sqrt',
) -> None:
    """Fly without assurance, and count the commands that it would change."""
    from rpo.analysis import assurance as counting
    from rpo_core.assurance.settings import Assurance
    from rpo_core.control.controller import load_controller
    from rpo_core.scenario.scenario import load

    found, settings = load(scenario), Assurance(speed=speed)
    rows = []
    for name in controller or [DEFAULT_CONTROLLER]:
        counted = counting.quiet(found, load_controller(name), settings)
        rows.append((name, *map(str, counted[:3]), f'{counted.margin_m_s:.3f} m/s'))
    heads = ('controller', 'flights', 'interventions', 'flights with one', 'least margin')
    print_table(heads, rows, f'{found.name}, speed limit `{speed}`')


@safety.command()
def drift(
    scenario: Flights = 'paper_training',
    controller: Controllers = None,
    radius: Annotated[float, Option(min=0.0, help='of the sphere to keep clear [m]')] = 5.0,
    beyond: Annotated[float, Option(min=0.0, help='look beyond this range only [m]')] = 15.0,
    orbits: Annotated[float, Option(min=0.0, max=100.0, help='length of a drift')] = 2.0,
    drag: Annotated[float, Option(min=0.0, help='largest differential acceleration [m/s^2]')] = 0.0,
    more_drag: Annotated[bool, Option('--more-drag', help='the chaser has the more drag')] = False,
) -> None:
    """Print from how many moments of flights a thruster silence would lead to the target."""
    from rpo.analysis.assurance import silence
    from rpo_core.control.controller import load_controller
    from rpo_core.scenario.scenario import load

    found, bounds = load(scenario), (-drag, 0.0 if more_drag else drag)
    rows = []
    for name in controller or [DEFAULT_CONTROLLER]:
        f = silence(found, load_controller(name), radius, beyond, orbits, bounds)
        rows.append((name, str(f.flights), str(f.unprotected), f'{100 * f.share:.1f} %'))
    heads = ('controller', 'flights', 'unprotected', 'of the time')
    title = f'{found.name}: drifts of {orbits:g} orbits that enter {radius:g} m'
    whose = ' more of the chaser' if more_drag else ''
    print_table(heads, rows, f'{title}, from beyond {beyond:g} m, drag {drag:g} m/s^2{whose}')


@safety.command()
def abort(
    scenario: Name = 'guarded',
    controller: Controller = DEFAULT_CONTROLLER,
    states: Annotated[int, Option(min=6, max=1_000_000, help='random states')] = 1000,
    seed: Annotated[int, Option(min=0, help='of the random states')] = 1,
    changes: Set = None,
) -> None:
    """Choose an abort from states of a plan or a flight, and random ones; count what is clear."""
    from rpo.analysis import assurance as counts
    from rpo_core.control.controller import load_controller
    from rpo_core.guidance.guidance import Guidance
    from rpo_core.scenario import overrides

    found = overrides.load(scenario, changes or [])
    machine = counts.machine_of(found)
    name = 'plan' if found.section(Guidance) else f'flight of {controller}'
    flown = counts.of_flight(found, load_controller(controller))
    rows = []
    for kind, looked in ((name, flown), ('random', counts.at_random(machine, states, seed))):
        bands = counts.bands(machine, looked)
        wanted = states // len(bands) if kind == 'random' else 0
        for band in bands:
            beyond = f'{band.least_m:g} to {band.most_m:g} m'
            if band.states < wanted:
                typer.echo(
                    f'{band.states} of {wanted} random states found from {beyond}: '
                    f'{counts.MISSES} draws in a row were outside the open set',
                    err=True,
                )
            if band.states:
                share = f'{band.clear} of {band.states}'
                rows.append((kind, beyond, share, f'{band.margin_m:.2f} m'))
    table = machine.table
    title = (
        f'{found.name}: aborts that stay out of {machine.keep_out_m:g} m for {table.orbits:g} '
        f'orbits, one thruster stuck on for {table.stuck_s:g} s, drag {table.drag_m_s2:g} m/s^2'
    )
    print_table(('states', 'range', 'clear', 'least margin'), rows, title)


@safety.command()
def thrusters(
    table: Annotated[
        str, Argument(help='preset, or scenario with `thrusters.table`', metavar='TABLE')
    ] = 'pairs_12',
    pairs: Annotated[bool, Option('--pairs', help='any two failures, not one')] = False,
    changes: Set = None,
) -> None:
    """Print the force that thrusters have without torque, whole and with failures.

    Of a preset, each thruster has 1 N. Full: all axes have the whole table's force, or
    `max_force_n` of the scenario, at once; none: to some side there is no force. Failures that the
    scenario knows are in every row.
    """
    from rpo_core.scenario import overrides
    from rpo_core.thrusters import table as thruster_table
    from rpo_core.thrusters.table import PRESETS, ThrusterTable

    if table in PRESETS:
        settings = ThrusterTable(preset=table, force_n=1.0)
        limit_n = thruster_table.known_authority(settings).box_n
    else:
        found = overrides.load(table, changes or [])
        if found.thrusters is None or found.thrusters.table is None:
            raise InputError(f'scenario {found.name} must have `thrusters.table`; it has none')
        settings, limit_n = found.thrusters.table, float(found.max_force_n)
    rows, left = [], Counter[str]()
    known = {f.thruster: f.stuck for f in settings.failures if f.known}
    for stuck in [{}, *thruster_table.failures(settings, pairs)]:
        has = thruster_table.authority(settings, known | stuck)
        verdict = has.left(limit_n)
        left[verdict] += bool(stuck)
        if not (pairs and stuck) or verdict == thruster_table.NONE:
            name = ', '.join(f'{name} {how}' for name, how in stuck.items()) or 'whole'
            numbers = (has.box_n, has.least_n, *has.axes_n)
            rows.append((name, verdict, *(f'{number + 0.0:.4g}' for number in numbers)))
    heads = ('stuck', 'left', 'at once', 'least', 'x+', 'x-', 'y+', 'y-', 'z+', 'z-')
    print_table(heads, rows, f'{table}: force without torque [N], full from {limit_n:g} N', left=2)
    counts = ', '.join(f'{left[kind]} {kind}' for kind in thruster_table.LEFT)
    typer.echo(f'of {left.total()} {"pairs of " if pairs else ""}failures: {counts}')
