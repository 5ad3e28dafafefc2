# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Trials of runtime assurance: hostile commands, faults and dispersions, many runs at once."""
