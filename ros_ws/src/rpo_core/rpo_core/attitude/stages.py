# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What this folder adds to scenarios and to the table of interfaces (`rpo_core.plugins`)."""

from rpo_core.attitude import chaser, pointing, target, unloading

__all__ = ['chaser', 'pointing', 'unloading']

target.add()
