# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Paths from one state to another in given time, and the least energy of those within half-spaces.

A force is held for each tick. The position at a tick is linear in the forces, so the least energy
of a path that ends in time and lies in half-spaces n_j . r(t_j) >= b_j is a quadratic program. All
that it needs of the motion is the least-energy path without half-spaces, and how much a push at
one of the ticks moves the positions at all of them (a Gramian, conditioned on the end).

Its dual has a multiplier for each half-space. Any multipliers >= 0 give a lower bound of the
energy: what `least` returns is that number, and needs no trust in how they were found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from rpo_core.files.validation import InputError
from rpo_core.kernels import CwStep
from rpo_core.world import cw
from rpo_guidance.transfer_kernels import path_of

Floats = NDArray[np.float64]

RIDGE = 1e-9
"""Added to the diagonal of the scaled dual, so that half-spaces that contradict each other have
finite multipliers; the bound is computed without it."""


class HalfSpaces(NamedTuple):
    """Half-spaces n . r(t_j) >= b: which of the ticks (m,), n (m, 3), b (m,) [m]."""

    when: NDArray[np.int64]
    normals: Floats
    least: Floats

    def with_more(self, more: HalfSpaces) -> HalfSpaces:
        """Return these and more."""
        return HalfSpaces(*(np.concatenate(pair) for pair in zip(self, more, strict=True)))


class Bridge:
    """All paths from a state to a state (6,) [m, m/s], seen at every `hold` of their ticks.

    ticks : (n,) at which positions are seen
    free : least energy [N^2 s] of all paths; path : (n, 3) [m] of that one
    """

    def __init__(
        self, start: Floats, end: Floats, step: CwStep, dt_s: float, length: int, hold: int
    ) -> None:
        if length < 4:
            raise InputError(f'a plan must have at least 4 ticks; got {length}')
        self._start, self._step, self._dt_s, self._length = start, step, dt_s, length
        a, self._b = cw.matrices(step)
        self._a, state, gramian = a, start, np.zeros((6, 6))
        self.ticks = np.arange(hold, length, hold)
        states, gramians = [], []
        for _ in range(length):  # the drift, and what forces of unit energy reach
            state, gramian = a @ state, a @ gramian @ a.T + self._b @ self._b.T / dt_s
            states.append(state)
            gramians.append(gramian)
        self._end_gramian, self._missing = gramian, end - state
        motion, count = np.linalg.matrix_power(a, hold), len(self.ticks)
        products = np.zeros((count, count, 3, 3))
        self._to_end = np.empty((count, 3, 6))
        for i, tick in enumerate(self.ticks):
            later = gramians[tick - 1][:3]
            for k in range(i, count):
                products[i, k], products[k, i] = later[:, :3], later[:, :3].T
                later = later @ motion.T
            rest = np.linalg.matrix_power(a, length - tick)
            self._to_end[i] = gramians[tick - 1][:3] @ rest.T
        flat = self._to_end.reshape(-1, 6)
        given_end = flat @ np.linalg.solve(gramian, flat.T)
        self._products = products - given_end.reshape(count, 3, count, 3).transpose(0, 2, 1, 3)
        multiplier = np.linalg.solve(gramian, self._missing)
        self.free = float(self._missing @ multiplier)
        self.path = np.array(states)[self.ticks - 1, :3] + self._to_end @ multiplier

    def least(self, spaces: HalfSpaces) -> tuple[float, Floats]:
        """Return the least energy [N^2 s] within half-spaces, and its multipliers (m,) >= 0.

        No path within them needs less, whatever the multipliers are: it is the value of the dual,
        2 d'u - u'Q u. They are found as least squares of u >= 0 (Lawson and Hanson, Solving least
        squares problems, 1974, chapter 23).
        """
        when, normals, least = spaces
        if not len(when):
            return self.free, np.zeros(0)
        blocks = self._products[when[:, None], when]
        q = np.einsum('ai,abij,bj->ab', normals, blocks, normals)
        scale = 1.0 / np.sqrt(np.diag(q))
        q *= scale[:, None] * scale
        room = (least - (normals * self.path[when]).sum(axis=1)) * scale
        root = np.linalg.cholesky(q + RIDGE * np.eye(len(q)))
        u, _ = nnls(root.T, np.linalg.solve(root, room), maxiter=100 * len(q))
        return self.free + max(0.0, float(2.0 * room @ u - u @ q @ u)), u * scale

    def path_of(self, spaces: HalfSpaces, multipliers: Floats) -> Floats:
        """Return the path (n, 3) [m] of the optimum that has these multipliers."""
        chosen = np.flatnonzero(multipliers)
        pushes = spaces.normals[chosen] * multipliers[chosen, None]
        moved: Floats = np.einsum('jmik,mk->ji', self._products[:, spaces.when[chosen]], pushes)
        return self.path + moved

    def forces(self, spaces: HalfSpaces, multipliers: Floats) -> Floats:
        """Return the forces (length, 3) [N] of the optimum that has these multipliers."""
        pushes = np.zeros((self._length + 1, 3))
        weighted = spaces.normals * multipliers[:, None]
        np.add.at(pushes, self.ticks[spaces.when], weighted)
        moved = np.einsum('mik,mi->k', self._to_end[spaces.when], weighted)
        forces = np.empty((self._length, 3))
        adjoint = np.linalg.solve(self._end_gramian, self._missing - moved)
        for tick in range(self._length - 1, -1, -1):
            forces[tick] = adjoint @ self._b / self._dt_s
            adjoint = adjoint @ self._a
            adjoint[:3] += pushes[tick]
        return forces

    def energy(self, forces: Floats) -> float:
        """Return the energy [N^2 s] of forces (length, 3) [N]."""
        return float((forces * forces).sum()) * self._dt_s

    def flown(self, forces: Floats) -> Floats:
        """Return the states (length + 1, 6) that forces (length, 3) lead through."""
        states = np.empty((len(forces) + 1, 6))
        path_of(tuple(self._start.tolist()), forces, self._step, states)
        return states
