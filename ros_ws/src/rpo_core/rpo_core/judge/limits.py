# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The conditions of the paper's training, and arrival, ours: limits of means and of the slew."""

from __future__ import annotations

ARRIVAL_WINDOW_S = 30.0
MAX_ARRIVAL_SPEED_M_S = 0.05
MAX_SLEW_N_S = 0.1
MAX_ARRIVAL_DISTANCE_M = 0.5
"""Ours: without it doing nothing is nearly optimal (the paper says 'to reach the target')."""
