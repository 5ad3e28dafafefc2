# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A C99 function without dependencies, with the bits of the kernels that fly.

It is made of the kernels' own source (`c_source`): `+ - * /`, sqrt and comparisons in their order.
So the compiler must not contract, reorder or compute in wider formats: no `-ffast-math`, and
`-ffp-contract=off` where the processor has FMA.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpo_core import kernels
from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy
from rpo_core.files.validation import InputError, shown
from rpo_core.kernels import State, Vector, saturate
from rpo_ctrl import baseline_kernels
from rpo_ctrl.baselines import Baseline
from rpo_export import parts
from rpo_export.c_expressions import number
from rpo_export.c_function import wrapped
from rpo_export.c_source import Source
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


class Function(NamedTuple):
    """What answers a state: the expression, and whether it counts ticks."""

    call: str
    counts_ticks: bool


class AlikeGains(NamedTuple):
    """Rows (k, d) of gains that are the same on each axis, a row a tick; and the limit."""

    gains: Any
    limit: float


def alike_force(state: State, tick: int, law: AlikeGains) -> Vector:
    """Force [N] of a law that treats all axes alike, with the bits of that for any gains."""
    x, y, z, vx, vy, vz = state
    last = len(law.gains) - 1
    row = law.gains[tick if tick < last else last]
    k, d = row[0], row[1]
    fx = -(k * x + 0.0 * y + 0.0 * z + d * vx + 0.0 * vy + 0.0 * vz)
    fy = -(0.0 * x + k * y + 0.0 * z + 0.0 * vx + d * vy + 0.0 * vz)
    fz = -(0.0 * x + 0.0 * y + k * z + 0.0 * vx + 0.0 * vy + d * vz)
    return saturate(fx, law.limit), saturate(fy, law.limit), saturate(fz, law.limit)


def function_of(source: Source, controller: AnyController) -> Function:
    """Add the kernels of a controller to a source; raises InputError if it has others."""
    if isinstance(controller, FuzzyController):
        source.record('LAW', controller.system.tables)
        force = source.function(kernels.fuzzy_force).name
        scales = ', '.join(map(number, controller.scales))
        return Function(f'{force}(state, (double3){{{{{scales}}}}}, &LAW)', counts_ticks=False)
    if not isinstance(controller, Baseline):
        raise InputError(
            f'`--to c` needs a fuzzy controller or one that answers by `kernel`, like those of '
            f'`rpo_ctrl.baselines`; got kind {shown(controller.kind)}'
        )
    kernel, law = controller.kernel()
    gains = getattr(law, 'gains', ())
    if kernel is baseline_kernels.baseline_force and controller.alike and len(gains):
        rows = np.asarray(gains)[:, [0, 3]]
        kernel, law = alike_force, AlikeGains(rows, law.limit)
    source.record('LAW', law)
    counts = controller.clock_s is not None
    tick = 'tick' if counts else '0'
    return Function(f'{source.function(kernel).name}(state, {tick}, &LAW)', counts)


def facts_of(controller: AnyController) -> str:
    """Return comments that say what the controller is."""
    if isinstance(controller, FuzzyController):
        lines = parts.facts(controller)
    else:
        lines = parts.named(controller)
    return '\n'.join(f'/* {line} */' for line in lines)


def force_prototype(controller: AnyController, name: str) -> str:
    """Return the prototype of `NAME_force`."""
    clock = None if isinstance(controller, FuzzyController) else controller.clock_s
    tick = '' if clock is None else 'int tick, '
    given = f'const double position_m[3], const double velocity_m_s[3], {tick}double force_n[3]'
    return wrapped(f'void {name}_force({given})')


def force_text(source: Source, controller: AnyController, name: str) -> str:
    """Return `NAME_force` in C."""
    function = function_of(source, controller)
    at = ', at a tick of the run' if function.counts_ticks else ''
    return _FORCE.format(at=at, prototype=force_prototype(controller, name), call=function.call)


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
