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

import typer

from rpo_cli.commands.shared import NoFail, end
from rpo_cli.display import plain_console, print_table
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.files.validation import InputError, printable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from rpo_core.control.controller import AnyController, FuzzyController
    from rpo_core.control.controller_file import Reason
    from rpo_core.files.scenario import Scenario
    from rpo_ctrl.explain import Decision, FiredRule
    from rpo_ctrl.family import Family
    from rpo_judge.analysis.certificate import Certificate
    from rpo_kernels.kernels import Vector


Words = Callable[[str], str]
_AS_THEY_ARE: Words = str


def explain(
    target: Annotated[
        str,
        typer.Argument(
            help='controller (shipped name or file), or run (folder or .mcap)  '
            f'[{DEFAULT_CONTROLLER}]'
        ),
    ] = '',
    at: Annotated[float | None, typer.Option(help='seconds into a run  [0]')] = None,
    state: Annotated[
        str | None,
        typer.Option(
            metavar='X,Y,Z,VX,VY,VZ',
            help='state in m and m/s, target LVLH; for a controller of attitude, how far it is '
            'turned off the reference and turns, in rad and rad/s',
        ),
    ] = None,
    controller: Annotated[str, typer.Option(hidden=True, help='the same, as an option')] = '',
    scenario: Annotated[
        str,
        typer.Option(
            help='with --state: scenario whose goal the chaser flies to (name or file)  [what the '
            'controller was trained for]'
        ),
    ] = '',
    certify: Annotated[bool, typer.Option('--certify', help='prove the control surface')] = False,
    no_fail: NoFail = False,
) -> None:
    """Say in words why the controller fires: its rules, or one decision of a run or a state.

    Exit code 1: the certificate fails, or the run holds another force or reason than is computed.
    """
    from rpo_core.control.controller import load_controller, only_fuzzy
    from rpo_ctrl import attitude
    from rpo_ctrl.explain import decisions
    from rpo_ctrl.family import Family
    from rpo_mcap.read.run_log import controller_of, read_run

    console = plain_console()
    if target and controller:
        raise InputError(f'give one controller; got {target} and `--controller {controller}`')
    target = target or controller or DEFAULT_CONTROLLER
    if certify and (state is not None or at is not None or _is_run(target)):
        raise InputError('`--certify` takes one controller, and nothing else')
    if scenario and state is None:
        raise InputError('`--scenario` needs `--state`')
    if attitude.is_one(target):
        if at is not None or scenario:
            raise InputError('a controller of attitude takes no `--at` and `--scenario`')
        axis = attitude.axis_of(target)
        console.print('One system for each axis of the chaser alike.')
        if state is not None:
            _print_decisions(console, decisions(axis, _state_of(state)), _of_angles)
            return
        end(not _explain_controller(console, axis, certify, _of_angles), no_fail)
        return
    if state is not None:
        loaded = controller_of(read_run(target)) if _is_run(target) else load_controller(target)
        seen = _from_goal(console, loaded, _state_of(state), scenario)
        if isinstance(loaded, Family):
            _print_reasons(console, loaded, seen, at or 0.0)
        elif at is not None:
            raise InputError('`--state` needs no `--at`: only a controller with a clock does')
        else:
            _print_decisions(console, decisions(only_fuzzy(loaded), seen))
        return
    if _is_run(target):
        end(not _explain_run(console, target, at or 0.0), no_fail)
        return
    if at is not None:
        raise InputError(
            f'`--at` needs a run, a folder or a .mcap file; got {target}. To explain a '
            'controller, leave out `--at`; to explain one state, give `--state`'
        )
    loaded = load_controller(target)
    if isinstance(loaded, Family):
        holds = _print_family(console, loaded, certify)
    else:
        holds = _explain_controller(console, only_fuzzy(loaded), certify)
    end(not holds, no_fail)


_ANGLES = {
    'position': 'attitude', 'velocity': 'rate', 'force': 'torque', 'Force': 'Torque',
    'm': 'rad', 'm/s': 'rad/s', 'N': 'N m', 'N/m': 'N m/rad', 'N/(m/s)': 'N m/(rad/s)',
}  # fmt: skip
_WORDS = re.compile(r'N/\(m/s\)|\b(?:N/m|m/s|position|velocity|force|Force|N|m)\b')


def _of_angles(text: str) -> str:
    """Return a text about a force axis as one about an axis of attitude: its words and units."""
    return _WORDS.sub(lambda found: _ANGLES[found[0]], text)


def _is_run(target: str) -> bool:
    return os.path.isdir(target) or target.endswith('.mcap')


def _state_of(text: str) -> tuple[float, ...]:
    """Return the six numbers of a text `x,y,z,vx,vy,vz`; raises InputError."""
    from rpo_ctrl.explain import STATE

    parts = text.split(',')
    try:
        values = tuple(float(part) for part in parts)
    except ValueError:
        values = ()
    if len(values) != 6 or not all(map(math.isfinite, values)):
        raise InputError(
            f'`state` must be 6 finite numbers {",".join(STATE)} in m and m/s; got {text!r}'
        )
    return values


def _from_goal(
    console: Console, controller: AnyController, state: Sequence[float], scenario: str
) -> Sequence[float]:
    """Return a state relative to the goal of a scenario, of what it was trained for by default."""
    from rpo_core.files.scenario import ScenarioSet, load
    from rpo_judge.evaluation.judgement import trained_for

    name = scenario or trained_for(controller)
    if not name:
        return state
    found = load(name)
    base = found.base if isinstance(found, ScenarioSet) else found
    if base.goal is None:
        return state
    force = ', '.join(f'{f:.6f}' for f in base.goal.force_n)
    console.print(
        f'Relative to the goal {list(base.goal_position_m)} m of {base.name}; the command gets '
        f'[{force}] N on top, which hold a chaser there.',
        soft_wrap=True,
    )
    return base.from_goal(state)


def _explain_run(console: Console, path: str, at: float) -> bool:
    """Print the decisions at the tick at or before a time; return whether the log has the same."""
    import numpy as np

    from rpo_core.control.controller import only_fuzzy
    from rpo_core.control.controller_file import received
    from rpo_core.wire.interfaces import BODY_TORQUE, ESTIMATED_DISTURBANCE
    from rpo_ctrl.explain import decisions
    from rpo_ctrl.family import Family
    from rpo_log.bag import open_run
    from rpo_mcap.read.run_log import controller_of, read_run, scenario_of

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
    controller, tick = controller_of(log), int(log.ticks[row])
    console.print(f'{printable(path)}, tick {tick}, {times[row]:g} s')
    if isinstance(controller, Family):
        reasons, same = _print_reasons_at(console, controller, state, tick)
    else:
        found = decisions(only_fuzzy(controller), state)
        _print_decisions(console, found)
        same = found[0].force_n, found[1].force_n, found[2].force_n
        reasons = [(d.strongest, d.pairs()) for d in found]
    logged = log.forces_n[row]
    if any(on_top):
        x, y, z = map(add, same, on_top)
        same = x, y, z
    if scenario.compensated:
        x, y, z = map(sub, same, pushed)
        same = x, y, z
    if not np.isfinite(logged).all():
        console.print('The log holds no force for this tick.')
    elif tuple(logged.tolist()) == same:
        console.print('The logged force is the same, bit for bit.')
    else:
        console.print(f'The logged force differs: {logged.tolist()} N; `rpo verify` says more.')
    if BODY_TORQUE in signals and scenario.named('attitude_control') is not None:
        _say_turn(console, signals, scenario)
    same_decision = _compare_decision(console, path, log.base.stamp_ns(tick), reasons)
    return same_decision and (not np.isfinite(logged).all() or tuple(logged.tolist()) == same)


def _say_turn(console: Console, signals: Mapping[str, list[float]], scenario: Scenario) -> None:
    """Print what the attitude control made of the command and of the attitude."""
    from rpo_attitude.turns import apart
    from rpo_core.wire import interfaces
    from rpo_kernels.attitude_kernels import synchronised

    wanted = signals.get(interfaces.REFERENCE_ATTITUDE, synchronised(scenario.mean_motion_rad_s))
    commanded = signals[interfaces.BODY_FORCE]
    for name, values in (
        (interfaces.REFERENCE_ATTITUDE, wanted),
        (interfaces.BODY_FORCE, commanded),
    ):
        if not all(map(math.isfinite, values)):
            console.print(f'The log holds no {name} for this tick.')
            return
    angle, rate = map(math.degrees, apart(signals[interfaces.CHASER_ATTITUDE], wanted))
    force, torque = (
        ', '.join(f'{value:.3g}' for value in signals[name])
        for name in (interfaces.BODY_FORCE, interfaces.BODY_TORQUE)
    )
    console.print(
        f"The chaser is {angle:.3g} deg and {rate:.3g} deg/s off its reference attitude. Its axes' "
        f'commands, after assurance: force [{force}] N, torque [{torque}] N m.',
        soft_wrap=True,
        markup=False,
    )


def _compare_decision(console: Console, path: str, stamp_ns: int, found: Sequence[Reason]) -> bool:
    """Compare with the decision that the controller published; return whether none differs."""
    from rpo_mcap.read.run_log import decision_at

    logged = decision_at(path, stamp_ns)
    if logged is None:
        console.print('The run holds no decision of the controller: this is computed anew.')
        return True
    age_s = (stamp_ns - logged.stamp_ns) / 1e9
    if age_s > 0.0:
        console.print(
            f'The controller said why {age_s:g} s before, not at this tick: this is computed anew.'
        )
        return True
    expected = [(sentence, {name: repr(x) for name, x in pairs}) for sentence, pairs in found]
    published = [(axis.message, dict(axis.values)) for axis in logged.axes]
    if published == expected:
        console.print('The controller said the same in flight, number by number.')
        return True
    for axis, (sentence, _) in zip('xyz', published, strict=False):
        console.print(f'In flight the controller said of {axis}: {printable(sentence)}')
    return False


def _print_decisions(
    console: Console, found: tuple[Decision, ...], words: Words = _AS_THEY_ARE
) -> None:
    from rpo_core.control.fuzzy import WORDS

    def error(value: float, saturated: bool) -> str:
        return f'{value + 0.0:.4f}{" (saturated)" if saturated else ""}'

    def share(decision: Decision, rule: FiredRule) -> str:
        part = decision.parts.get(rule.force) if rule.decides else None
        ties = len(decision.deciding(rule.force))
        return f'{100.0 * part.share / ties:.1f} %' if part else ''

    for decision in found:
        console.print(f'\n{decision.axis}', style='bold', end='')
        said = (
            f': position {decision.position_m:g} m, velocity '
            f'{decision.velocity_m_s:g} m/s; position error '
            f'{error(decision.position_error, decision.position_saturated)}, velocity error '
            f'{error(decision.velocity_error, decision.velocity_saturated)}'
        )
        console.print(words(said), soft_wrap=True)
        console.print(words(decision.reasons.sentence), soft_wrap=True)
        position = dict(zip(WORDS, decision.position_grades, strict=True))
        velocity = dict(zip(WORDS, decision.velocity_grades, strict=True))
        rows = [
            (
                f'{rule.position} {position[rule.position]:.4f}',
                f'{rule.velocity} {velocity[rule.velocity]:.4f}',
                rule.force,
                f'{rule.strength:.4f}',
                share(decision, rule),
            )
            for rule in decision.rules
        ]
        headings = ('position error', 'velocity error', 'force', 'strength', 'share')
        print_table(tuple(map(words, headings)), rows, left=3)
        sums = ' + '.join(
            f'{part.share:.4f} × {part.centroid:.4f} ({word})'
            for word, part in decision.parts.items()
        )
        console.print(
            words(
                f'centroid: {sums or "no rule"} = {decision.output:.4f} → {decision.force_n:.6f} N'
            ),
            soft_wrap=True,
        )


def _explain_controller(
    console: Console, controller: FuzzyController, certify: bool, words: Words = _AS_THEY_ARE
) -> bool:
    """Print a controller; return whether its certificate, if asked for, holds."""
    from rpo_judge.analysis.certificate import certify as examine
    from rpo_judge.analysis.rule_base import WELL, warnings

    position, velocity, force = controller.scales
    console.print(controller.name, style='bold', end='')
    console.print(f': {printable(controller.description)}')
    said = (
        f'An error of 1 is {position:g} m of position, {velocity:g} m/s of velocity; '
        f'a force of 1 is {force:g} N. {controller.system.samples} samples.'
    )
    console.print(words(said))
    _print_rules(controller, words)
    _print_functions(controller, words)
    found = warnings(controller.system)
    for warning in found:
        console.print('warning', style='yellow', end='')
        console.print(f': {words(warning)}', soft_wrap=True)
    if not found:
        console.print(f'No warnings. {WELL}')
    if not certify:
        return True
    certificate = examine(controller.system)
    _print_certificate(console, controller, certificate, words)
    return certificate.holds


def _print_rules(controller: FuzzyController, words: Words) -> None:
    from rpo_judge.analysis.rule_base import FORCES, force_rows

    headings, rows = force_rows(controller.system)
    print_table(tuple(map(words, headings)), rows, words(FORCES))


def _print_functions(controller: FuzzyController, words: Words) -> None:
    from rpo_export.formats import variables

    parts, rows = variables(controller), []
    for terms in zip(*(part.terms for part in parts), strict=True):
        cells = [
            ', '.join(f'{scale * x:.4g}' if abs(x) <= 1.0 else '–' for x in feet)
            for (_, feet), scale in zip(terms, controller.scales, strict=True)
        ]
        rows.append((terms[0][0], *cells))
    units = zip(parts, ('m', 'm/s', 'N'), strict=True)
    names = (words(f'{part.name.replace("_", " ")} [{unit}]') for part, unit in units)
    headings = ('word', *names)
    print_table(headings, rows, 'Membership functions: left foot, peak, right foot')


def _print_certificate(
    console: Console, controller: FuzzyController, certificate: Certificate, words: Words
) -> None:
    def say(line: str) -> None:
        console.print(words(line), soft_wrap=True)

    colors = {'proven': 'green', 'refuted': 'red', 'undecided': 'yellow'}
    console.print('\nCertificate', style='bold', end='')
    say(' over all position errors e and velocity errors v in [-1, 1]')
    for claim in certificate.claims:
        color = colors[claim.verdict]
        console.print(f'{claim.verdict:9s}', style=color, end='')
        say(f' {claim.name}: {claim.statement}')
        for p in claim.points:
            say(f'            u({p.position_error!r}, {p.velocity_error!r}) = {p.output!r}')
    position, velocity, force = controller.scales
    by_name = {claim.name: claim for claim in certificate.claims}
    say(
        f'In units: |force| <= {by_name["output"].bound * force:.4g} N; at most '
        f'{by_name["slope in position error"].bound * force / position:.4g} N/m and '
        f'{by_name["slope in velocity error"].bound * force / velocity:.4g} N/(m/s).\n'
        f'{certificate.boxes} boxes; the kernel is within {certificate.rounding:.1e} of the exact '
        f'surface. The certificate {"holds" if certificate.holds else "FAILS"}.'
    )


def _print_family(console: Console, controller: Family, certify: bool) -> bool:
    """Print the rules of a controller, with `certify` what is proven; return whether it holds."""
    console.print(controller.name, style='bold', end='')
    console.print(f': {printable(controller.description)}')
    for title, headings, rows in controller.tables():
        print_table(headings, rows, title)
    if not certify:
        return True
    claims = controller.claims()
    console.print('\nCertificate', style='bold')
    for claim in claims:
        word, color = ('proven', 'green') if claim.holds else ('not proven', 'yellow')
        console.print(f'{word:10s}', style=color, end='')
        console.print(f' {claim.name}: {claim.statement}', soft_wrap=True)
    return all(claim.holds for claim in claims if claim.needed)


def _print_reasons_at(
    console: Console, controller: Family, state: Sequence[float], tick: int
) -> tuple[Sequence[Reason], Vector]:
    """Print the reasons of a state at a tick; return them and the force [N]."""
    from rpo_ctrl.explain import in_words

    x, y, z, vx, vy, vz = state
    reasons = controller.reasons((x, y, z, vx, vy, vz), tick)
    for axis, (sentence, pairs) in zip('xyz', reasons, strict=True):
        console.print(f'\n{axis}', style='bold', end='')
        said = in_words(controller, sentence, dict(pairs)).sentence
        console.print(f': {said}', soft_wrap=True)
        console.print(', '.join(f'{name} {value:.4g}' for name, value in pairs), soft_wrap=True)
    return reasons, controller.force_n((x, y, z), (vx, vy, vz), tick)


def _print_reasons(
    console: Console, controller: Family, state: Sequence[float], at_s: float
) -> None:
    """Print the reasons of a state at a time since the start of the run; raises InputError."""
    if controller.clock_s is None:
        if at_s:
            raise InputError(f'`--at` needs a run: controller {controller.name} has no clock')
        _print_reasons_at(console, controller, state, 0)
        return
    if not 0.0 <= at_s <= 1e6:
        raise InputError(f'`--at` must be from 0 s to 1e6 s; got {at_s:g}')
    tick = round(at_s / controller.clock_s)
    console.print(f'tick {tick}, {tick * controller.clock_s:g} s since the start')
    _print_reasons_at(console, controller, state, tick)
