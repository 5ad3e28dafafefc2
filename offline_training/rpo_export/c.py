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
from rpo_export.kernel_source import law_of
from rpo_kernels import kernels
from rpo_montecarlo.outputs import identifier

SOURCE = """{facts}
/* Exported by `rpo export`. C99 and IEEE 754 doubles; the bits are those of the flown kernel, if
   compiled with -std=c99 -ffp-contract=off, without -ffast-math. Units: m, m/s, N; target LVLH. */
#include <float.h>
#include <math.h>

#if FLT_EVAL_METHOD != 0
#error "doubles are evaluated in a wider format: on x86 compile with -msse2 -mfpmath=sse"
#endif

{kernels}

{functions}
"""

HEADER = """{facts}
/* Exported by `rpo export`, with {source}. Units: m, m/s, N; axes: target LVLH.

   Compile:  cc -std=c99 -O2 -ffp-contract=off -c {source}
   Use:      {use}
*/
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

{prototypes}

#ifdef __cplusplus
}}
#endif

#endif
"""

_FORCE = """/* Commanded force [N] of a finite relative state{at}. */
{prototype}
{{
    const double6 state = {{{{position_m[0], position_m[1], position_m[2], velocity_m_s[0],
        velocity_m_s[1], velocity_m_s[2]}}}};
    const double3 force = {call};
    for (int axis = 0; axis < 3; axis++) {{
        force_n[axis] = force.at[axis];
    }}
}}"""

_AXIS = """/* Commanded force [N] on one axis, of the position [m] and velocity [m/s] on it. */
{prototype}
{{
    return {function}(position_m, velocity_m_s, {scales}, &LAW);
}}"""

_SELF_TEST = """{cases}

/* 0 if this machine computes the forces of the flown kernel; else which case differs. */
{prototype}
{{
    for (int i = 0; i < {count}; i++) {{
        const double *c = cases[i];
        double force_n[3];
        {name}_force(&c[0], &c[3], {tick}force_n);
        if (force_n[0] != c[6] || force_n[1] != c[7] || force_n[2] != c[8]) {{
            return i + 1;
        }}
    }}
    return 0;
}}"""

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
    return _FORCE.format(at=at, prototype=prototype, call=function_of(source, controller))


def _axis_prototype(name: str) -> str:
    return f'double {name}_axis_force(double position_m, double velocity_m_s)'


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
    return _SELF_TEST.format(
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
            _AXIS.format(prototype=_axis_prototype(name), function=axis, scales=scales)
        )
    functions.append(_self_test(controller, name))
    return SOURCE.format(
        facts=facts_of(controller), kernels=source.text(), functions='\n\n'.join(functions)
    )


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
    return HEADER.format(
        facts=facts_of(controller),
        source=source.replace('*/', '* /'),
        use='double force_n[3];\n             '
        f'{name}_force((double[]){{10.0, 60.0, -40.0}}, (double[]){{0.0, 0.0, 0.0}}, '
        f'{tick}force_n);',
        guard=f'{name.upper()}_H',
        prototypes='\n\n'.join(prototypes),
    )
