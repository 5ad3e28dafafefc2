# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A C99 function without dependencies, with the bits of the kernels that fly.

It is made of the kernels' own source (`c_source`): `+ - * /`, sqrt and comparisons in their order.
So the compiler must not contract, reorder or compute in wider formats: no `-ffast-math`, and
`-ffp-contract=off` where the processor has FMA.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpo_core.chain.stage import Place, section_of
from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy
from rpo_core.files.scenario import Goal, Scenario
from rpo_core.files.validation import InputError
from rpo_ctrl.baselines import Baseline
from rpo_export import formats
from rpo_export.c_source import Source, number, wrapped
from rpo_export.formats import filled
from rpo_export.kernel_source import law_of
from rpo_kernels import kernels
from rpo_montecarlo.outputs import identifier

_CASES, _TICKS_APART = 24, 37

_PUBLIC = re.compile(r'^(/\*(?:(?!\*/).)*\*/\n(?:void|int|double) [^{;]*)\n\{', re.M | re.S)
"""Comment and prototype of a function that is not static."""


class Files(NamedTuple):
    """A source file in C, and its header."""

    source: str
    header: str


def files_of(
    name: str, facts: str, kernels: Source, functions: Sequence[str], use: str, file: str,
    *types: str,
) -> Files:  # fmt: skip
    """Return a source file of kernels and of functions that call them, and its header.

    name : what the names of the functions begin with; facts : comments on both
    use : an example, for the header; types : those that the functions take
    file : name of the source file
    """
    joined = '\n\n'.join([*types, *functions])
    source = filled('c', 'source', facts=facts, kernels=kernels.text(), functions=joined)
    prototypes = (f'{found};' for found in _PUBLIC.findall(source))
    header = filled(
        'c',
        'header',
        facts=facts,
        source=file.replace('*/', '* /'),
        use=use,
        guard=f'{name.upper()}_H',
        prototypes='\n\n'.join([*types, *prototypes]),
    )
    return Files(source, header)


def counts_ticks(controller: AnyController) -> bool:
    """Whether the answer of a controller depends on the tick."""
    return not isinstance(controller, FuzzyController) and controller.clock_s is not None


def facts_of(controller: AnyController) -> str:
    """Return comments that say what the controller is."""
    return '\n'.join(f'/* {line} */' for line in formats.facts(controller))


def vector(name: str, values: Sequence[float]) -> str:
    """Return a vector of numbers in C."""
    return f'static const double {name}[3] = {{{", ".join(map(number, values))}}};'


def about_force(at: str = '', scenario: Scenario | None = None) -> str:
    """Return the comment on `NAME_force`.

    at : what else than the state the force follows from; scenario : whose goal it has
    """
    if scenario is None:
        words = f'{at}. {" ".join(formats.GOAL)}'
    else:
        where = 'target' if scenario.goal is None else f'{list(scenario.goal.position_m)} m'
        name = formats.one_line(scenario.name)
        words = (
            f' relative to the target{at}. It flies to the goal of {name}, {where}, and has the '
            'force that holds there. Shaping, assurance and thrusters act later.'
        )
    return wrapped(f'/* Commanded force [N] of a finite state{words} */')


def force_text(
    source: Source, controller: AnyController, name: str, scenario: Scenario | None = None
) -> str:
    """Add the kernels of a controller to a source; return `NAME_force` in C, which calls them.

    scenario : whose goal the function has, and the force that holds there

    Raises InputError if it does not answer by a kernel.
    """
    goal = None if scenario is None else scenario.goal
    names = [f'position_m[{i}]' for i in range(3)]
    if goal is not None:
        names = [f'{name} - GOAL_M[{i}]' for i, name in enumerate(names)]
    names += [f'velocity_m_s[{i}]' for i in range(3)]
    law, counts = law_of(controller), counts_ticks(controller)
    source.record('LAW', law.tables)
    second = 'tick' if counts else '0'
    if law.scales:
        second = f'(double3){{{{{", ".join(map(number, law.scales))}}}}}'
    given = f'const double position_m[3], const double velocity_m_s[3], {"int tick, " * counts}'
    force = filled(
        'c',
        'force',
        about=about_force(', at a tick of the run' * counts, scenario),
        prototype=wrapped(f'void {name}_force({given}double force_n[3])'),
        state=wrapped(f'const double6 state = {{{{{", ".join(names)}}}}};', 1),
        call=f'{source.function(law.kernel).name}(state, {second}, &LAW)',
        hold='' if goal is None else ' + HOLD_N[axis]',
    )
    constants = [] if goal is None else [vector('GOAL_M', goal[0]), vector('HOLD_N', goal[1])]
    return '\n\n'.join([*constants, force])


def table(name: str, kind: str, rows: Sequence[Sequence[Any]]) -> str:
    """Return a table of numbers in C."""
    lines = ',\n'.join(wrapped('{' + ', '.join(map(number, row)) + '}', 1) for row in rows)
    return f'static const {kind} {name}[{len(rows)}][{len(rows[0])}] = {{\n{lines}}};'


def _flown_to(scenario: Scenario, controller: AnyController) -> Goal | None:
    """Return the goal of a scenario; raises InputError where C would not be what flies to it."""
    if any(section_of(s).place is Place.GUIDANCE for s in scenario.sections):
        raise InputError(
            f'`--scenario` has a goal that stands; {scenario.name} has section `guidance`, whose '
            'reference moves: export without `--scenario`, and subtract the reference'
        )
    if scenario.compensated:
        raise InputError(
            f'`--scenario` has no estimate of the disturbance, which {scenario.name} subtracts: '
            'take `estimator.compensate` out of the file'
        )
    if not isinstance(controller, FuzzyController):
        controller.refuse_other_ticks(scenario.dt_s)
    return scenario.goal


def _self_test(controller: AnyController, name: str, goal: Goal | None) -> str:
    draw = np.random.default_rng(1)
    rounded = np.round(draw.normal(size=(_CASES, 6)) * [30, 30, 30, 0.4, 0.4, 0.4], 3)
    origin, hold_n = np.zeros(6), np.zeros(3)
    if goal is not None:
        origin[:3], hold_n = goal.position_m, np.array(goal.force_n)
    states = (rounded - origin).tolist()
    if isinstance(controller, Baseline):
        kernel, law = controller.kernel()
        forces = [kernel(tuple(s), _TICKS_APART * i, law) for i, s in enumerate(states)]
    else:
        forces = [only_fuzzy(controller).force_n(s[:3], s[3:]) for s in states]
    answers = np.array(forces) if goal is None else np.array(forces) + hold_n
    rows = [(*s, *force) for s, force in zip(rounded.tolist(), answers.tolist(), strict=True)]
    return filled(
        'c',
        'self_test',
        cases=table('cases', 'double', rows),
        count=_CASES,
        name=name,
        tick=f'{_TICKS_APART} * i, ' * counts_ticks(controller),
    )


def files(controller: AnyController, file: str, scenario: Scenario | None = None) -> Files:
    """Return the C of a controller: `NAME_force` and `NAME_self_test`, and a header.

    file : name of the source file, whose header has an example of its use
    scenario : to whose goal it flies; None: the caller subtracts the goal

    Raises InputError if it is of a kind whose kernels are not known.
    """
    name, source = identifier(controller.name), Source()
    goal = None if scenario is None else _flown_to(scenario, controller)
    functions = [force_text(source, controller, name, scenario)]
    if isinstance(controller, FuzzyController) and scenario is None:
        axis = source.function(kernels.axis_force).name
        scales = ', '.join(map(number, controller.scales))
        functions.append(filled('c', 'axis', name=name, function=axis, scales=scales))
    functions.append(_self_test(controller, name, goal))
    use = (
        'double force_n[3];\n             '
        f'{name}_force((double[]){{10.0, 60.0, -40.0}}, (double[]){{0.0, 0.0, 0.0}}, '
        f'{"0, " * counts_ticks(controller)}force_n);'
    )
    return files_of(name, facts_of(controller), source, functions, use, file)
