# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters: from a command to force, torque and propellant."""
