# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The mathematics once more, straight from the definitions, slow and independent of `rpo_core`."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import mpmath
import numpy as np
from scipy.linalg import expm

import rpo_core
from rpo_core.control.fuzzy import WORDS, FuzzySystem, MembershipFunctions

MP = mpmath.mp.clone()
MP.dps = 50

Triangle = tuple[float, float, float]


@cache  # quadrature asks 18 times for each point
def transition_matrix(n, t):
    """Return the Clohessy-Wiltshire state-transition matrix, 50 digits, as textbooks print it."""
    nt = n * t
    s, c = MP.sin(nt), MP.cos(nt)
    return MP.matrix(
        [
            [4 - 3 * c, 0, 0, s / n, 2 * (1 - c) / n, 0],
            [6 * (s - nt), 1, 0, -2 * (1 - c) / n, (4 * s - 3 * nt) / n, 0],
            [0, 0, c, 0, 0, s / n],
            [3 * n * s, 0, 0, c, 2 * s, 0],
            [-6 * n * (1 - c), 0, 0, -2 * s, 4 * c - 3, 0],
            [0, 0, -n * s, 0, 0, c],
        ]
    )


def input_matrix(n, t, mass):
    """Return the response to a force held for t: the integral of the velocity columns over time."""

    def entry(row, column):
        return MP.quad(lambda s: transition_matrix(n, s)[row, 3 + column], [0, t]) / mass

    return MP.matrix([[entry(row, column) for column in range(3)] for row in range(6)])


def system_matrices(n, mass):
    """Return A (6, 6) and B (6, 3) of x' = A x + B f."""
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 4] = 3 * n * n, 2 * n
    a[4, 3] = -2 * n
    a[5, 2] = -n * n
    b = np.vstack([np.zeros((3, 3)), np.eye(3) / mass])
    return a, b


def exact_step(n, mass, dt_s):
    """Return A (6, 6) and B (6, 3) of a step under a held force, by the matrix exponential."""
    a, b = system_matrices(n, mass)
    whole = expm(np.block([[a, b], [np.zeros((3, 9))]]) * dt_s)
    return whole[:6, :6], whole[:6, 6:]


def triangles(functions: MembershipFunctions) -> dict[str, Triangle]:
    """Return the feet and peak of each word on the whole axis; LP's right foot lies outside."""
    f = functions
    return {
        'LN': (-2.0, -1.0, -f.lp_left),
        'SN': (-f.sp_right, -f.sp_centre, -f.sp_left),
        'Z': (-f.z_half_width, 0.0, f.z_half_width),
        'SP': (f.sp_left, f.sp_centre, f.sp_right),
        'LP': (f.lp_left, 1.0, 2.0),
    }


def grade(x: float, triangle: Triangle) -> float:
    """Return the membership of x in a triangle whose feet have grade 0 and whose peak has 1."""
    left, peak, right = triangle
    if x == peak:
        return 1.0
    if left < x < peak:
        return (x - left) / (peak - left)
    if peak < x < right:
        return (right - x) / (right - peak)
    return 0.0


def rule_cells(system: FuzzySystem) -> Iterator[tuple[str, str, str]]:
    """Yield (velocity word, position word, consequent) of the 25 rules."""
    for row, words in zip(WORDS, system.rules.words, strict=True):
        for column, word in zip(WORDS, words, strict=True):
            yield row, column, word


def aggregate(system: FuzzySystem, e: float, v: float) -> tuple[list[float], list[float]]:
    """Return the output samples y and the aggregated membership of each, rule by rule."""
    positions, velocities = triangles(system.position), triangles(system.velocity)
    forces = triangles(system.force)
    half = (system.samples - 1) // 2
    samples = [j / half for j in range(-half, half + 1)]
    output = [0.0] * len(samples)
    for row, column, word in rule_cells(system):
        weight = min(grade(e, positions[column]), grade(v, velocities[row]))
        if weight == 0.0:
            continue
        clipped = [min(weight, grade(y, forces[word])) for y in samples]
        output = [max(pair) for pair in zip(output, clipped, strict=True)]
    return samples, output


def mamdani(system: FuzzySystem, e: float, v: float) -> float:
    """Return the centroid of the aggregated output; 0 where it is empty."""
    samples, output = aggregate(system, e, v)
    area = math.fsum(output)
    return math.fsum(y * mu for y, mu in zip(samples, output, strict=True)) / area if area else 0.0


def steepest(functions: MembershipFunctions) -> float:
    """Return the largest slope of any word, infinite for a vertical edge."""
    slope = 0.0
    for word, (left, peak, right) in triangles(functions).items():
        edges = (peak - left, right - peak)
        if word in ('LN', 'LP'):  # the far edge lies outside [-1, 1]
            edges = (min(1.0 - functions.lp_left, 1.0),)
        slope = max(slope, *(1 / edge if edge else math.inf for edge in edges))
    return slope


def python(code: str, *arguments: str, **environment: str) -> str:
    """Run a program in a fresh interpreter that finds `rpo_core`; return what it printed."""
    root = Path(rpo_core.__file__).parents[1]
    path = os.pathsep.join([str(root), os.environ.get('PYTHONPATH', '')])
    done = subprocess.run(
        [sys.executable, '-c', code, *arguments],
        env={**os.environ, 'PYTHONPATH': path, **environment},
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
