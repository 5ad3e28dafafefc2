# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A C99 function without dependencies, with the bits of the kernels.

`+ - * /` and comparisons in the order of the kernels; so the compiler must not contract, reorder or
compute in wider formats: no `-ffast-math`, and `-ffp-contract=off` where the processor has FMA.
"""

from __future__ import annotations

from typing import Any

from rpo_core import kernels
from rpo_core.controller import FuzzyController
from rpo_training.export import parts

_SOURCE = """{facts}
/* Exported by `rpo export`. C99 and IEEE 754 doubles; the bits are those of the flown kernel, if
   compiled with -std=c99 -ffp-contract=off, without -ffast-math. Units: m, m/s, N; target LVLH. */
#include <float.h>

#if FLT_EVAL_METHOD != 0
#error "doubles are evaluated in a wider format: on x86 compile with -msse2 -mfpmath=sse"
#endif

#define POSITION_SCALE_M {position!r}
#define VELOCITY_SCALE_M_S {velocity!r}
#define FORCE_SCALE_N {force!r}
#define HALF {half} /* samples of (0, 1]; their mirror images and 0 complete the {samples} */
#define LANES {lanes}

enum {{ LN, SN, Z, SP, LP }};

{tables}

static double saturate(double value, double limit)
{{
    if (value > limit) return limit;
    if (value < -limit) return -limit;
    return value;
}}

static double least(double a, double b) {{ return a < b ? a : b; }}

static double greatest(double a, double b) {{ return a > b ? a : b; }}

static double triangle(double x, double left, double centre, double right)
{{
    if (x < centre) return x > left ? (x - left) / (centre - left) : 0.0;
    if (x > centre) return x < right ? (right - x) / (right - centre) : 0.0;
    return 1.0;
}}

static void memberships(double x, const double f[5], double grades[5])
{{
    double size = x < 0.0 ? -x : x;
    double small = triangle(size, f[1], f[2], f[3]);
    double large = triangle(size, f[4], 1.0, 2.0);
    int positive = x >= 0.0;
    grades[LN] = positive ? 0.0 : large;
    grades[SN] = positive ? 0.0 : small;
    grades[Z] = triangle(size, -f[0], 0.0, f[0]);
    grades[SP] = positive ? small : 0.0;
    grades[LP] = positive ? large : 0.0;
}}

static double centroid(const double strength[5])
{{
    double moment = 0.0, area = strength[Z];
    for (int lane = 0; lane < LANES; lane++) {{
        double lane_moment = 0.0, lane_area = 0.0;
        for (int i = lane; i < HALF; i += LANES) {{
            double middle = least(output_z[i], strength[Z]);
            double right = greatest(middle, least(output_sp[i], strength[SP]));
            double left = greatest(middle, least(output_sp[i], strength[SN]));
            right = greatest(right, least(output_lp[i], strength[LP]));
            left = greatest(left, least(output_lp[i], strength[LN]));
            lane_moment += samples[i] * (right - left);
            lane_area += right + left;
        }}
        moment += lane_moment;
        area += lane_area;
    }}
    return area > 0.0 ? moment / area : 0.0;
}}

/* Commanded force [N] of one axis from a finite position [m] and velocity [m/s]. */
double {name}_axis_force(double position_m, double velocity_m_s)
{{
    double e[5], v[5], strength[5] = {{0.0, 0.0, 0.0, 0.0, 0.0}};
    memberships(saturate(-position_m / POSITION_SCALE_M, 1.0), position_functions, e);
    memberships(saturate(-velocity_m_s / VELOCITY_SCALE_M_S, 1.0), velocity_functions, v);
    for (int row = 0; row < 5; row++)
        for (int column = 0; column < 5; column++) {{
            int word = rules[5 * row + column];
            strength[word] = greatest(strength[word], least(e[column], v[row]));
        }}
    return FORCE_SCALE_N * centroid(strength);
}}

/* Commanded force [N] of a finite relative state. */
void {name}_force(const double position_m[3], const double velocity_m_s[3], double force_n[3])
{{
    for (int axis = 0; axis < 3; axis++)
        force_n[axis] = {name}_axis_force(position_m[axis], velocity_m_s[axis]);
}}
"""


_HEADER = """{facts}
/* Exported by `rpo export`, with {source}. Units: m, m/s, N; axes: target LVLH.

   Compile:  cc -std=c99 -O2 -ffp-contract=off -c {source}
   Use:      double force_n[3];
             {name}_force((double[]){{10.0, 60.0, -40.0}}, (double[]){{0.0, 0.0, 0.0}}, force_n);
*/
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

/* Commanded force [N] on one axis, of the position [m] and velocity [m/s] on it. */
double {name}_axis_force(double position_m, double velocity_m_s);

/* Commanded force [N] of a finite relative state. */
void {name}_force(const double position_m[3], const double velocity_m_s[3], double force_n[3]);

#ifdef __cplusplus
}}
#endif

#endif
"""


def header(controller: FuzzyController, source: str) -> str:
    """Return the C header of the source file of that name, with an example of its use."""
    name = parts.identifier(controller.name)
    return _HEADER.format(
        facts='\n'.join(f'/* {line} */' for line in parts.facts(controller)),
        source=source.replace('*/', '* /'),
        name=name,
        guard=f'{name.upper()}_H',
    )


def text(controller: FuzzyController) -> str:
    """Return the C source of a controller: `NAME_axis_force` and `NAME_force`."""
    tables = controller.system.tables
    position, velocity, force = controller.scales
    arrays = {
        'position_functions': tables.position,
        'velocity_functions': tables.velocity,
        'samples': tables.samples,
        'output_z': tables.z,
        'output_sp': tables.sp,
        'output_lp': tables.lp,
    }
    return _SOURCE.format(
        facts='\n'.join(f'/* {line} */' for line in parts.facts(controller)),
        position=position,
        velocity=velocity,
        force=force,
        half=len(tables.samples),
        samples=controller.system.samples,
        lanes=kernels.LANES,
        tables='\n\n'.join(
            [
                _array('signed char', 'rules', tables.rules),
                *(_array('double', name, values) for name, values in arrays.items()),
            ]
        ),
        name=parts.identifier(controller.name),
    )


def _array(kind: str, name: str, values: Any) -> str:
    return f'static const {kind} {name}[{len(values)}] = {{\n{parts.listed(values, 4, 96)}}};'
