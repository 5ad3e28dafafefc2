# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers: the paper's fuzzy system, its families, baselines, and why they command what."""
