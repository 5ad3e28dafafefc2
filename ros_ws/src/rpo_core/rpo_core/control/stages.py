# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The kinds that this folder adds to controller files; `rpo_core.plugins` imports it."""

from rpo_core.control import attitude, baselines, table, time_to_go

__all__ = ['attitude', 'baselines', 'table', 'time_to_go']
