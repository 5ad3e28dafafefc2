# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns of dispersed closed loops: how often a controller succeeds, and how surely."""
