# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The sections that this folder adds to scenario files; `rpo_core.plugins` imports it."""

from rpo_core.thrusters import thrusters

__all__ = ['thrusters']
