# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A C99 function without dependencies, with the bits of the kernels that fly.

It is made of the kernels' own source (`c_source`): `+ - * /`, sqrt and comparisons in their order.
So the compiler must not contract, reorder or compute in wider formats: no `-ffast-math`, and
`-ffp-contract=off` where the processor has FMA.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy
from rpo_ctrl.baselines import Baseline
from rpo_export import formats
from rpo_export.c_source import Source, number, wrapped
from rpo_export.formats import filled
from rpo_export.kernel_source import law_of
from rpo_kernels import kernels
from rpo_montecarlo.outputs import identifier

_CASES, _TICKS_APART = 24, 37


def function_of(source: Source, controller: AnyController) -> str:
    """Add the kernels of a controller to a source; return the expression of its force.

    Raises InputError if it does not answer by a kernel.
    """
    law = law_of(controller)
    source.record('LAW', law.tables)
    force = source.function(law.kernel).name
    if law.scales:
        scales = ', '.join(map(number, law.scales))
        return f'{force}(state, (double3){{{{{scales}}}}}, &LAW)'
    return f'{force}(state, {"tick" if law.counts_ticks else "0"}, &LAW)'


def facts_of(controller: AnyController) -> str:
    """Return comments that say what the controller is."""
    return '\n'.join(f'/* {line} */' for line in formats.facts(controller))


def force_prototype(controller: AnyController, name: str) -> str:
    """Return the prototype of `NAME_force`."""
    clock = None if isinstance(controller, FuzzyController) else controller.clock_s
    tick = '' if clock is None else 'int tick, '
    given = f'const double position_m[3], const double velocity_m_s[3], {tick}double force_n[3]'
    return wrapped(f'void {name}_force({given})')


def force_text(source: Source, controller: AnyController, name: str) -> str:
    """Return `NAME_force` in C."""
    prototype = force_prototype(controller, name)
    at = ', at a tick of the run' if 'int tick' in prototype else ''
    return filled('c', 'force', at=at, prototype=prototype, call=function_of(source, controller))


def _axis_prototype(name: str) -> str:
    return f'double {name}_axis_force(double position_m, double velocity_m_s)'


def source_text(facts: str, source: Source, functions: Sequence[str]) -> str:
    """Return a source file in C: comments, kernels, and the functions that call them."""
    joined = '\n\n'.join(functions)
    return filled('c', 'source', facts=facts, kernels=source.text(), functions=joined)


def table(name: str, kind: str, rows: Sequence[Sequence[Any]]) -> str:
    """Return a table of numbers in C."""
    lines = ',\n'.join(wrapped('{' + ', '.join(map(number, row)) + '}', 1) for row in rows)
    return f'static const {kind} {name}[{len(rows)}][{len(rows[0])}] = {{\n{lines}}};'


def _self_test(controller: AnyController, name: str) -> str:
    draw = np.random.default_rng(1)
    states = np.round(draw.normal(size=(_CASES, 6)) * [30, 30, 30, 0.4, 0.4, 0.4], 3).tolist()
    if isinstance(controller, Baseline):
        kernel, law = controller.kernel()
        forces = [kernel(tuple(s), _TICKS_APART * i, law) for i, s in enumerate(states)]
    else:
        forces = [only_fuzzy(controller).force_n(s[:3], s[3:]) for s in states]
    rows = [(*s, *map(float, force)) for s, force in zip(states, forces, strict=True)]
    counts = 'int tick' in force_prototype(controller, name)
    return filled(
        'c',
        'self_test',
        cases=table('cases', 'double', rows),
        prototype=f'int {name}_self_test(void)',
        count=_CASES,
        name=name,
        tick=f'{_TICKS_APART} * i, ' if counts else '',
    )


def text(controller: AnyController) -> str:
    """Return the C source of a controller: `NAME_force`, `NAME_self_test`.

    Raises InputError if it is of a kind whose kernels are not known.
    """
    name, source = identifier(controller.name), Source()
    functions = [force_text(source, controller, name)]
    if isinstance(controller, FuzzyController):
        axis = source.function(kernels.axis_force).name
        scales = ', '.join(map(number, controller.scales))
        functions.append(
            filled('c', 'axis', prototype=_axis_prototype(name), function=axis, scales=scales)
        )
    functions.append(_self_test(controller, name))
    return source_text(facts_of(controller), source, functions)


def header(controller: AnyController, source: str) -> str:
    """Return the C header of the source file of that name, with an example of its use."""
    name = identifier(controller.name)
    force = force_prototype(controller, name)
    tick = '0, ' if 'int tick' in force else ''
    at = ', at a tick of the run' if tick else ''
    prototypes = [f'/* Commanded force [N] of a finite relative state{at}. */\n{force};']
    if isinstance(controller, FuzzyController):
        prototypes.append(
            '/* Commanded force [N] on one axis, of the position [m] and velocity [m/s] on it. */\n'
            f'{_axis_prototype(name)};'
        )
    prototypes.append(
        '/* 0 if this machine computes the forces of the flown kernel; else which case differs. */'
        f'\nint {name}_self_test(void);'
    )
    return filled(
        'c',
        'header',
        facts=facts_of(controller),
        source=source.replace('*/', '* /'),
        use='double force_n[3];\n             '
        f'{name}_force((double[]){{10.0, 60.0, -40.0}}, (double[]){{0.0, 0.0, 0.0}}, '
        f'{tick}force_n);',
        guard=f'{name.upper()}_H',
        prototypes='\n\n'.join(prototypes),
    )
