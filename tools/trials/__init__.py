# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Trials of the running nodes that print a table: latency, lost messages, endurance."""
