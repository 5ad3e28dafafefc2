# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The allocation of a table of thrusters in one C99 file, with the bits of the flown kernel."""

from __future__ import annotations

import numpy as np

from rpo.exports import c
from rpo.exports.c_source import Source, number, wrapped
from rpo.exports.formats import filled
from rpo.montecarlo.outputs import identifier
from rpo_core.kernels.jit import as_table
from rpo_core.thrusters.allocation_kernels import LIMIT, ROWS, SCRATCH, THRUST, allocate
from rpo_core.thrusters.table import IDENTITY, ThrusterTable, table_of

_CASES = 64


def files(name: str, settings: ThrusterTable, file: str) -> c.Files:
    """Return the C of a table, `NAME_allocate` and `NAME_self_test`, and its header.

    file : name of the source file. Raises InputError.
    """
    made, source = table_of(settings, 1.0, 0.0, None, IDENTITY), Source()
    source.record('TABLE', made)
    written = source.function(allocate, ('scratch', type(made), 'scratch'))
    draw, work, rows = np.random.default_rng(1), as_table(np.zeros(SCRATCH)), []
    for case in range(_CASES):
        size = 0.7 * float(np.sum(made.most)) / 3.0
        force, torque = draw.normal(size=3) * size, draw.normal(size=3) * (case % 3) * 0.1 * size
        most = np.array(made.most)
        most[case % len(most)] *= float(case % 4 > 0)
        for i, value in enumerate(most.tolist()):
            work[LIMIT + i] = value
        wanted = [*force.tolist(), *(value / made.lever for value in torque.tolist())]
        share, _ = allocate(as_table(wanted), made, work)
        thrusts = [float(work[THRUST + i]) for i in range(made.number)]
        rows.append([*force.tolist(), *torque.tolist(), *most.tolist(), *thrusts, float(share)])
    own, count = identifier(name), made.number
    prototype = wrapped(
        f'double {own}_allocate(const double force_n[3], const double torque_nm[3], '
        f'const double most_n[{count}], double thrust_n[{count}])'
    )
    function = filled(
        'c_allocation',
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
        cases=c.table('cases', 'double', rows),
        name=own,
        count=_CASES,
    )
    facts = wrapped(f'/* thrusters of {name}, in this order: {", ".join(settings.names)} */')
    use = f'share = {own}_allocate(force_n, torque_nm, most_n, thrust_n);'
    return c.files_of(own, facts, source, [function], use, file)
