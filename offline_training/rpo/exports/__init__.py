# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, and as source code without dependencies.

A format is a function of a controller, and a line in `FORMATS`; `formats` reads some of them
back.
"""

from __future__ import annotations

from collections.abc import Callable

from rpo.exports import c, formats
from rpo.montecarlo.outputs import identifier
from rpo_core.control.controller import AnyController, FuzzyController, dumps
from rpo_core.files.validation import choice

FORMATS: dict[str, Callable[[AnyController], str]] = {
    'fis': formats.fis,
    'fll': formats.fll,
    'json': formats.json,
    'c': lambda controller: c.files(controller, '').source,
    'yaml': dumps,
}
"""MATLAB, FuzzyLite; JSON; C99 functions with the bits of the kernels; the file that flies."""


def text_of(controller: AnyController, name: str) -> str:
    """Return a controller in one of `FORMATS`; raises InputError if that cannot say it."""
    return FORMATS[choice('--to', name, FORMATS)](controller)


_OF_ATTITUDE = (
    ('Units: m, m/s, N; axes: target LVLH', 'Units: rad, rad/s, N m; body axes'),
    ('Units: m, m/s, N; target LVLH', 'Units: rad, rad/s, N m; body axes'),
    (c.about_force(), '/* Commanded torque [N m] of finite errors. */'),
    ('Commanded force [N] on one axis, of the position [m] and velocity [m/s] on it, as above',
     'Commanded torque [N m] on one axis, of the attitude [rad] and rate [rad/s] error on it'),
    ('{10.0, 60.0, -40.0}', '{0.1, 0.6, -0.4}'), ('computes the forces', 'computes the torques'),
    ('position_m', 'attitude_rad'), ('velocity_m_s', 'rate_rad_s'), ('force_n', 'torque_nm'),
    ('one axis of a final approach', 'the attitude about one body axis'),
    ('position_error = -position / position_scale, velocity_error = -velocity / velocity_scale,',
     'attitude_error = -attitude / angle_rad, rate_error = -rate / rate_rad_s,'),
    ('force on that axis = force * force_scale', 'torque about that axis = output * torque_nm'),
    ('position_scale_m', 'angle_rad'), ('velocity_scale_m_s', 'rate_rad_s'),
    ('force_scale_n', 'torque_nm'),
)  # fmt: skip


def attitude_files(axis: FuzzyController, file: str) -> c.Files:
    """Return the C of the law of a fuzzy attitude controller, without feed-forward.

    axis : its law (`FuzzyAttitude.axis`); file : name of the source file
    """
    name = identifier(axis.name)
    source, header = c.files(axis, file)
    own = [(f'{name}_{part}force(', f'{name}_{part}torque(') for part in ('', 'axis_')]
    for old, new in (*own, *_OF_ATTITUDE):
        source, header = source.replace(old, new), header.replace(old, new)
    return c.Files(source, header)
