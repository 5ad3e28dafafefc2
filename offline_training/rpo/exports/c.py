# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A C99 function without dependencies, with the bits of the kernels that fly.

It is made of the kernels' own source (`c_source`): `+ - * /`, sqrt and comparisons in their order.
So the compiler must not contract, reorder or compute in wider formats: no `-ffast-math`, and
`-ffp-contract=off` where the processor has FMA. The allocation of a table of thrusters is in C too.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpo.exports import formats
from rpo.exports.c_source import Source, number, wrapped
from rpo.exports.formats import filled
from rpo.exports.kernel_source import law_of
from rpo.montecarlo.outputs import identifier
from rpo_core.control import inference
from rpo_core.control.baselines import Baseline
from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy
from rpo_core.kernels.jit import as_table
from rpo_core.thrusters.allocation_kernels import LIMIT, ROWS, SCRATCH, THRUST, allocate
from rpo_core.thrusters.table import IDENTITY, ThrusterTable, table_of

_CASES, _TICKS_APART = 24, 37

PUBLIC = re.compile(r'^(/\*(?:(?!\*/).)*\*/\n(?:void|int|double) [^{;]*)\n\{', re.M | re.S)
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
    source = filled('source', facts=facts, kernels=kernels.text(), functions=joined)
    prototypes = (f'{head};' for head in PUBLIC.findall(source))
    header = filled(
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


def about_force(at: str = '') -> str:
    """Return the comment on `NAME_force`; at : what else than the state the force follows from."""
    return wrapped(f'/* Commanded force [N] of a finite state{at}. {" ".join(formats.GOAL)} */')


def force_text(source: Source, controller: AnyController, name: str) -> str:
    """Add the kernels of a controller to a source; return `NAME_force` in C, which calls them.

    Raises InputError if it does not answer by a kernel.
    """
    names = (f'{part}[{i}]' for part in ('position_m', 'velocity_m_s') for i in range(3))
    law, counts = law_of(controller), counts_ticks(controller)
    source.record('LAW', law.tables)
    second = 'tick' if counts else '0'
    if law.scales:
        second = f'(double3){{{{{", ".join(map(number, law.scales))}}}}}'
    given = f'const double position_m[3], const double velocity_m_s[3], {"int tick, " * counts}'
    return filled(
        'force',
        about=about_force(', at a tick of the run' * counts),
        prototype=wrapped(f'void {name}_force({given}double force_n[3])'),
        state=wrapped(f'const double6 state = {{{{{", ".join(names)}}}}};', 1),
        call=f'{source.function(law.kernel).name}(state, {second}, &LAW)',
    )


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
    rows = [(*s, *force) for s, force in zip(states, forces, strict=True)]
    return filled(
        'self_test',
        cases=table('cases', 'double', rows),
        count=_CASES,
        name=name,
        tick=f'{_TICKS_APART} * i, ' * counts_ticks(controller),
    )


def files(controller: AnyController, file: str) -> Files:
    """Return the C of a controller: `NAME_force` and `NAME_self_test`, and a header.

    file : name of the source file, whose header has an example of its use

    Raises InputError if it is of a kind whose kernels are not known.
    """
    name, source = identifier(controller.name), Source()
    functions = [force_text(source, controller, name)]
    if isinstance(controller, FuzzyController):
        axis = source.function(inference.axis_force).name
        scales = ', '.join(map(number, controller.scales))
        functions.append(filled('axis', name=name, function=axis, scales=scales))
    functions.append(_self_test(controller, name))
    use = (
        'double force_n[3];\n             '
        f'{name}_force((double[]){{10.0, 60.0, -40.0}}, (double[]){{0.0, 0.0, 0.0}}, '
        f'{"0, " * counts_ticks(controller)}force_n);'
    )
    return files_of(name, facts_of(controller), source, functions, use, file)


_ALLOCATED = 64


def allocation_files(name: str, settings: ThrusterTable, file: str) -> Files:
    """Return the C of a table, `NAME_allocate` and `NAME_self_test`, and its header.

    file : name of the source file. Raises InputError.
    """
    made, source = table_of(settings, 1.0, 0.0, None, IDENTITY), Source()
    source.record('TABLE', made)
    written = source.function(allocate, ('scratch', type(made), 'scratch'))
    draw, work, rows = np.random.default_rng(1), as_table(np.zeros(SCRATCH)), []
    for case in range(_ALLOCATED):
        size = 0.7 * float(np.sum(made.most)) / 3.0
        force, torque = draw.normal(size=3) * size, draw.normal(size=3) * (case % 3) * 0.1 * size
        limits_n = np.array(made.most)
        limits_n[case % len(limits_n)] *= float(case % 4 > 0)
        for i, value in enumerate(limits_n.tolist()):
            work[LIMIT + i] = value
        wanted = [*force.tolist(), *(value / made.lever for value in torque.tolist())]
        share, _ = allocate(as_table(wanted), made, work)
        thrusts = [float(work[THRUST + i]) for i in range(made.number)]
        rows.append([*force.tolist(), *torque.tolist(), *limits_n.tolist(), *thrusts, float(share)])
    prefix, count = identifier(name), made.number
    prototype = wrapped(
        f'double {prefix}_allocate(const double force_n[3], const double torque_nm[3], '
        f'const double most_n[{count}], double thrust_n[{count}])'
    )
    function = filled(
        'allocate',
        prototype=prototype,
        scratch=SCRATCH,
        rows=ROWS,
        lever=number(made.lever),
        number=count,
        limit=LIMIT,
        thrust=THRUST,
        answer=source.spelled(written.returns),
        allocate=written.name,
        cases=table('cases', 'double', rows),
        name=prefix,
        count=_ALLOCATED,
    )
    facts = wrapped(f'/* thrusters of {name}, in this order: {", ".join(settings.names)} */')
    use = f'share = {prefix}_allocate(force_n, torque_nm, most_n, thrust_n);'
    return files_of(prefix, facts, source, [function], use, file)
