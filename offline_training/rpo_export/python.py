# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A Python module without dependencies: the kernels' own source, and the tables as numbers."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from typing import Any

from rpo_core import kernels
from rpo_core.control.controller import FuzzyController
from rpo_export import parts

_KERNELS: tuple[Callable[..., Any], ...] = (
    kernels.saturate,
    kernels.triangle,
    kernels.memberships,
    kernels.fire_rules,
    kernels.centroid,
    kernels.infer,
    kernels.axis_force,
)

_MODULE = '''{facts}
"""Commanded force of the fuzzy controller `{name}`; exported by `rpo export`.

The bits are those of the flown kernel. Positions in m, velocities in m/s, forces in N, target LVLH.
"""
from collections import namedtuple

LN, SN, Z, SP, LP = range(5)
LANES = {lanes}

FisTables = namedtuple('FisTables', {fields!r})

POSITION_SCALE_M, VELOCITY_SCALE_M_S, FORCE_SCALE_N = {scales!r}

FIS = FisTables(
{tables}
)


def force_n(position_m, velocity_m_s):
    """Commanded force (fx, fy, fz) of a finite relative state."""
    return tuple(force(r, v) for r, v in zip(position_m, velocity_m_s))


def force(position_m, velocity_m_s):
    """Commanded force of one axis."""
    return axis_force(
        position_m, velocity_m_s, POSITION_SCALE_M, VELOCITY_SCALE_M_S, FORCE_SCALE_N, FIS
    )


{functions}
'''


def text(controller: FuzzyController) -> str:
    """Return the Python source of a controller."""
    tables = controller.system.tables
    return _MODULE.format(
        facts='\n'.join(f'# {line}' for line in parts.facts(controller)),
        name=parts.one_line(controller.name),
        lanes=kernels.LANES,
        fields=' '.join(kernels.FisTables._fields),
        scales=controller.scales,
        tables='\n'.join(
            f'    {name}=(\n{parts.listed(values, 8, 88)},\n    ),'
            for name, values in tables._asdict().items()
        ),
        functions='\n\n\n'.join(map(source, _KERNELS)),
    )


def source(kernel: Callable[..., Any]) -> str:
    """Return the source of a kernel without its decorator and its annotations."""
    function: Any = getattr(kernel, 'py_func', kernel)  # numba keeps it there
    node = ast.parse(inspect.getsource(function)).body[0]
    if not isinstance(node, ast.FunctionDef):
        raise TypeError(f'{kernel} must be a plain function')
    node.decorator_list, node.returns = [], None
    for argument in node.args.args:
        argument.annotation = None
    return ast.unparse(node)
