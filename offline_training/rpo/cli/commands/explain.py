# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo explain`."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from operator import add, sub
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, end, numbers_of
from rpo.display import plain_console, print_table
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.files.validation import InputError, printable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rpo_core.control.controller import AnyController, FuzzyController
    from rpo_core.control.family import Family
    from rpo_core.scenario.scenario import Scenario

Words = Callable[[str], str]


def explain(
    target: Annotated[
        str,
        Argument(help='controller (name or file), or run (folder or .mcap)'),
    ] = DEFAULT_CONTROLLER,
    at: Annotated[float | None, Option(help='seconds into a run  [0]')] = None,
    state: Annotated[
        str | None,
        Option(
            metavar='X,Y,Z,VX,VY,VZ',
            help='in m and m/s, target LVLH; of attitude, error and its rate, in rad and rad/s',
        ),
    ] = None,
    scenario: Annotated[
        str, Option(help='with --state: scenario whose goal it flies to  [what it was trained for]')
    ] = '',
    certify: Annotated[bool, Option('--certify', help='prove the control surface')] = False,
    no_fail: NoFail = False,
) -> None:
    """Say in words why the controller fires: its rules, or one decision of a run or a state.

    Exit code 1: the certificate fails, or the run holds another force or reason than is computed.
    """
    from rpo_core.control import attitude
    from rpo_core.control.controller import load_controller, only_fuzzy
    from rpo_core.control.family import Family
    from rpo_log.read.run_log import controller_of, read_run

    is_run = os.path.isdir(target) or target.endswith('.mcap')
    if certify and (state is not None or at is not None or is_run):
        raise InputError('`--certify` takes one controller, and nothing else')
    if scenario and state is None:
        raise InputError('`--scenario` needs `--state`')
    holds = True
    if attitude.is_one(target):
        if at is not None or scenario:
            raise InputError('a controller of attitude takes no `--at` and `--scenario`')
        axis = attitude.axis_of(target)
        _say('One system for each axis of the chaser alike.')
        if state is not None:
            _print_decisions(axis, _state_of(state), _of_angles)
        else:
            holds = _explain_fuzzy(axis, certify, _of_angles)
    elif state is not None:
        loaded = controller_of(read_run(target)) if is_run else load_controller(target)
        read = _from_goal(loaded, _state_of(state), scenario)
        _print_why(loaded, read, _tick_of(loaded, at))
    elif is_run:
        holds = _explain_run(target, at or 0.0)
    elif at is not None:
        raise InputError(
            f'`--at` needs a run, a folder or a .mcap file; got {target}. To explain a '
            'controller, leave out `--at`; to explain one state, give `--state`'
        )
    elif isinstance(loaded := load_controller(target), Family):
        holds = _explain_family(loaded, certify)
    else:
        holds = _explain_fuzzy(only_fuzzy(loaded), certify)
    end(not holds, no_fail)


_ANGLES = {
    'position': 'attitude', 'velocity': 'rate', 'force': 'torque', 'Force': 'Torque',
    'm': 'rad', 'm/s': 'rad/s', 'N': 'N m', 'N/m': 'N m/rad', 'N/(m/s)': 'N m/(rad/s)',
}  # fmt: skip
_WORDS = re.compile(r'N/\(m/s\)|\b(?:N/m|m/s|position|velocity|force|Force|N|m)\b')


def _of_angles(text: str) -> str:
    """Return a text about a force axis as one about an axis of attitude: its words and units."""
    return _WORDS.sub(lambda found: _ANGLES[found[0]], text)


def _say(text: str, title: str = '', style: str = 'bold', words: Words = str) -> None:
    """Print a line in some words, after a title in a style."""
    console = plain_console()
    console.print(title, style=style, end='')
    console.print(words(text), soft_wrap=True)


def _state_of(text: str) -> list[float]:
    """Return the six numbers of a text `x,y,z,vx,vy,vz`; raises InputError."""
    values = numbers_of(text)
    if len(values) != 6:
        raise InputError(
            f'`state` must be 6 finite numbers x,y,z,vx,vy,vz in m and m/s; got {text!r}'
        )
    return values


def _from_goal(controller: AnyController, state: Sequence[float], scenario: str) -> Sequence[float]:
    """Return a state relative to the goal of a scenario, of what it was trained for by default."""
    from rpo.analysis.judgement import trained_for
    from rpo_core.judge.similarity import base_of
    from rpo_core.scenario.scenario import load

    name = scenario or trained_for(controller)
    base = base_of(load(name)) if name else None
    if base is None or base.goal is None:
        return state
    force = ', '.join(f'{f:.6f}' for f in base.goal.force_n)
    _say(
        f'Relative to the goal {list(base.goal_position_m)} m of {base.name}; the command gets '
        f'[{force}] N on top, which hold a chaser there.'
    )
    return base.from_goal(state)


def _tick_of(controller: AnyController, at_s: float | None) -> int:
    """Return the tick of a time since the start of a run; raises InputError without a clock."""
    from rpo_core.control.family import Family

    if not isinstance(controller, Family):
        if at_s is not None:
            raise InputError('`--state` needs no `--at`: only a controller with a clock does')
        return 0
    at_s = at_s or 0.0
    if controller.clock_s is None:
        if at_s:
            raise InputError(f'`--at` needs a run: controller {controller.name} has no clock')
        return 0
    if not 0.0 <= at_s <= 1e6:
        raise InputError(f'`--at` must be from 0 s to 1e6 s; got {at_s:g}')
    tick = round(at_s / controller.clock_s)
    _say(f'tick {tick}, {tick * controller.clock_s:g} s since the start')
    return tick


def _explain_run(path: str, at: float) -> bool:
    """Print the decisions at the tick at or before a time; return whether the log has the same."""
    import numpy as np

    from rpo_core.control.controller_file import received
    from rpo_core.wire.interfaces import BODY_TORQUE, ESTIMATED_DISTURBANCE, REFERENCE_STATE
    from rpo_log.bag import open_run
    from rpo_log.read.run_log import controller_of, read_run, scenario_of

    log = read_run(open_run(path))
    times = log.times_s
    if not (math.isfinite(at) and times[0] <= at <= times[-1]):
        raise InputError(
            f'`--at` must be within the log, {times[0]:g} to {times[-1]:g} s; got {at:g}'
        )
    row = int(np.searchsorted(times, at + 1e-9, side='right')) - 1
    if not np.isfinite(log.states[row]).all():
        raise InputError(f'{path}: has no state at {times[row]:g} s')
    scenario = scenario_of(log)
    signals = {name: values[row].tolist() for name, values in log.values.items()}
    state, on_top = received(scenario, signals)
    pushed = signals[ESTIMATED_DISTURBANCE] if scenario.compensated else ()
    if not np.isfinite([*state, *pushed]).all():
        raise InputError(f'{path}: does not hold what the controller read at {times[row]:g} s')
    tick = int(log.ticks[row])
    of = 'reference' if REFERENCE_STATE in signals else 'goal' if scenario.goal else 'target'
    _say(f'{printable(path)}, tick {tick}, {times[row]:g} s; positions are relative to the {of}')
    force_n = _print_why(controller_of(log), state, tick)
    if any(on_top):
        force_n = tuple(map(add, force_n, on_top))
    if scenario.compensated:
        force_n = tuple(map(sub, force_n, pushed))
    logged = log.forces_n[row].tolist()
    lost, same = not np.isfinite(logged).all(), tuple(logged) == force_n
    if lost:
        _say('The log holds no force for this tick.')
    elif same:
        _say('The logged force is the same, bit for bit.')
    else:
        _say(f'The logged force differs: {logged} N; `rpo verify` says more.')
    if BODY_TORQUE in signals and scenario.named('attitude_control') is not None:
        _say_turn(signals, scenario)
    return lost or same


def _say_turn(signals: Mapping[str, list[float]], scenario: Scenario) -> None:
    """Print what the attitude control made of the command and of the attitude."""
    from rpo_core.attitude.attitude_kernels import synchronised
    from rpo_core.attitude.pointing import apart
    from rpo_core.wire import interfaces

    reference, command = interfaces.REFERENCE_ATTITUDE, interfaces.BODY_FORCE
    wanted = signals.get(reference, synchronised(scenario.mean_motion_rad_s))
    for name, values in ((reference, wanted), (command, signals[command])):
        if not all(map(math.isfinite, values)):
            _say(f'The log holds no {name} for this tick.')
            return
    angle, rate = map(math.degrees, apart(signals[interfaces.CHASER_ATTITUDE], wanted))
    force, torque = (
        ', '.join(f'{value:.3g}' for value in signals[name])
        for name in (command, interfaces.BODY_TORQUE)
    )
    _say(
        f"The chaser is {angle:.3g} deg and {rate:.3g} deg/s off its reference attitude. Its axes' "
        f'commands, after assurance: force [{force}] N, torque [{torque}] N m.'
    )


def _print_why(controller: AnyController, state: Sequence[float], tick: int) -> tuple[float, ...]:
    """Print why a controller answers to a state at a tick as it does; return its force [N]."""
    from rpo_core.control.controller import only_fuzzy
    from rpo_core.control.family import Family

    x, y, z, vx, vy, vz = state
    if not isinstance(controller, Family):
        fuzzy = only_fuzzy(controller)
        _print_decisions(fuzzy, state)
        return fuzzy.force_n((x, y, z), (vx, vy, vz))
    reasons = controller.reasons((x, y, z, vx, vy, vz), tick)
    for axis, reason in zip('xyz', reasons, strict=True):
        _say(f': {reason.sentence}', f'\n{axis}')
        _say(', '.join(f'{name} {value + 0.0:.4g}' for name, value in reason.numbers))
    return controller.force_n((x, y, z), (vx, vy, vz), tick)


def _print_decisions(
    controller: FuzzyController, state: Sequence[float], words: Words = str
) -> None:
    from rpo_core.control.explain import decisions

    def error(name: str, value: float, share: float, scale: str, saturated: bool) -> str:
        size = f'{0.0 - value:g} {scale.split()[1]}, {share + 0.0:.4f} of {scale}'
        return f'{name} error = −{name} = {size}{" (saturated)" if saturated else ""}'

    place, rate = f'{controller.position_scale_m:g} m', f'{controller.velocity_scale_m_s:g} m/s'
    for d in decisions(controller, state):
        at = f': position {d.position_m:g} m, velocity {d.velocity_m_s:g} m/s'
        _say(at, f'\n{d.axis}', words=words)
        errors = (
            error('position', d.position_m, d.position_error, place, d.position_saturated),
            error('velocity', d.velocity_m_s, d.velocity_error, rate, d.velocity_saturated),
        )
        _say('; '.join(errors), words=words)
        _say(d.reasons.sentence, words=words)
        rows = []
        for rule in d.rules:
            part = d.parts.get(rule.force) if rule.decides else None
            ties = len(d.deciding(rule.force))
            position = f'{rule.position} {rule.position_grade:.4f}'
            velocity = f'{rule.velocity} {rule.velocity_grade:.4f}'
            share = f'{100.0 * part.share / ties:.1f} %' if part else ''
            rows.append((position, velocity, rule.force, f'{rule.strength:.4f}', share))
        headings = ('position error', 'velocity error', 'force', 'strength', 'share')
        print_table(tuple(map(words, headings)), rows, left=3)
        sums = ' + '.join(f'{p.share:.4f} × {p.centroid:.4f} ({w})' for w, p in d.parts.items())
        made = f'{d.output:.4f} → {d.force_n:.6f} N'
        _say(f'centroid: {sums or "no rule"} = {made}', words=words)


def _explain_fuzzy(controller: FuzzyController, certify: bool, words: Words = str) -> bool:
    """Print a controller; return whether its certificate, if asked for, holds."""
    from rpo.analysis.rule_base import FORCES, WELL, force_rows, warnings
    from rpo.exports.formats import variables

    position, velocity, force = controller.scales
    _say(f': {printable(controller.description)}', controller.name)
    said = (
        f'position error = −position, where 1 is {position:g} m; velocity error = −velocity, where '
        f'1 is {velocity:g} m/s; a force of 1 is {force:g} N. {controller.system.samples} samples.'
    )
    _say(said, words=words)
    headings, rows = force_rows(controller.system)
    print_table(tuple(map(words, headings)), rows, words(FORCES))
    parts, rows = variables(controller), []
    for terms in zip(*(part.terms for part in parts), strict=True):
        cells = [
            ', '.join(f'{scale * x:.4g}' if abs(x) <= 1.0 else '–' for x in feet)
            for (_, feet), scale in zip(terms, controller.scales, strict=True)
        ]
        rows.append((terms[0][0], *cells))
    units = zip(parts, ('m', 'm/s', 'N'), strict=True)
    names = (words(f'{part.name.replace("_", " ")} [{unit}]') for part, unit in units)
    print_table(('word', *names), rows, 'Membership functions: left foot, peak, right foot')
    found = warnings(controller.system)
    for warning in found:
        _say(f': {words(warning)}', 'warning', 'yellow')
    if not found:
        _say(f'No warnings. {WELL}')
    return not certify or _print_certificate(controller, words)


def _print_certificate(controller: FuzzyController, words: Words) -> bool:
    """Print what is proven of the control surface of a controller; return whether all is."""
    from rpo.proof.certificate import certify

    certificate = certify(controller.system)
    colours = {'proven': 'green', 'refuted': 'red', 'undecided': 'yellow'}
    what = ' over all position errors e and velocity errors v in [-1, 1]'
    _say(what, '\nCertificate', words=words)
    for claim in certificate.claims:
        said = f' {claim.name}: {claim.statement}'
        _say(said, f'{claim.verdict:9s}', colours[claim.verdict], words)
        for p in claim.points:
            _say(f'            u({p.position_error!r}, {p.velocity_error!r}) = {p.output!r}')
    position, velocity, force = controller.scales
    bounds = {claim.name: claim.bound for claim in certificate.claims}
    said = (
        f'In units: |force| <= {bounds["output"] * force:.4g} N; at most '
        f'{bounds["slope in position error"] * force / position:.4g} N/m and '
        f'{bounds["slope in velocity error"] * force / velocity:.4g} N/(m/s).\n'
        f'{certificate.boxes} boxes; the kernel is within {certificate.rounding:.1e} of the exact '
        f'surface. The certificate {"holds" if certificate.holds else "FAILS"}.'
    )
    _say(said, words=words)
    return certificate.holds


def _explain_family(controller: Family, certify: bool) -> bool:
    """Print the rules of a controller, with `certify` what is proven; return whether it holds."""
    _say(f': {printable(controller.description)}', controller.name)
    for title, headings, rows in controller.tables():
        print_table(headings, rows, title)
    claims = controller.claims() if certify else []
    if certify:
        _say('', '\nCertificate')
    for claim in claims:
        word, colour = ('proven', 'green') if claim.holds else ('not proven', 'yellow')
        _say(f' {claim.name}: {claim.statement}', f'{word:10s}', colour)
    return all(claim.holds for claim in claims if claim.needed)
