# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a search minimises: energy, and penalties for conditions that are missed.

Add a term to `fitness`. The results of the presets in `tests/training/expected` must not change.
"""
