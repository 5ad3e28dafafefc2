# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of the simulated world: CW plant and disturbance injector."""
