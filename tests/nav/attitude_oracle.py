# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""An attitude filter written otherwise: matrices, SciPy's rotations, attitude against the stars."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation


def skew(v):
    """Return the matrix of the cross product with a vector."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def transition(rate, dt):
    """Return the matrix (6, 6) of the errors of a tick at a constant rate, by the exponential."""
    a = np.zeros((6, 6))
    a[:3, :3], a[:3, 3:] = -skew(rate), -np.eye(3)
    return expm(a * dt)


class Mekf:
    """Errors: 2 x vector part of estimated^-1 * true, in the chaser's axes; bias of the gyro."""

    def __init__(self, attitude, sigmas, dt, noise, walk, star, axes):
        self.attitude, self.bias = Rotation.from_quat(attitude), np.zeros(3)
        self.p = np.diag(np.square(np.repeat(sigmas, 3)))
        self.dt, self.q = dt, np.zeros((6, 6))
        whole, shared, walked = noise**2 * dt + walk**2 * dt**3 / 3, walk**2 * dt**2 / 2, walk**2
        self.q[:3, :3], self.q[3:, 3:] = np.eye(3) * whole, np.eye(3) * walked * dt
        self.q[:3, 3:] = self.q[3:, :3] = -np.eye(3) * shared
        self.r = axes.T @ np.diag(np.square(star)) @ axes

    def predict(self, before, after):
        rate = 0.5 * (before + after) - self.bias
        self.attitude *= Rotation.from_rotvec(rate * self.dt)
        f = transition(rate, self.dt)
        self.p = f @ self.p @ f.T + self.q

    def update(self, star):
        """Take an attitude against the stars; return its NIS."""
        off = (self.attitude.inv() * star).as_quat(canonical=True)[:3] * 2.0
        spread = self.p[:3, :3] + self.r
        gain = self.p[:, :3] @ np.linalg.inv(spread)
        error = gain @ off
        keep = np.eye(6) - gain @ np.eye(3, 6)
        self.p = keep @ self.p @ keep.T + gain @ self.r @ gain.T
        half = 0.5 * error[:3]
        self.attitude *= Rotation.from_quat([*half, np.sqrt(1.0 - half @ half)])
        self.bias = self.bias + error[3:]
        return off @ np.linalg.solve(spread, off)
