# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Search of fuzzy controllers: genes, searches by ask and tell, fitness, runs in their folders.

A new search goes into `algorithms` (ask, tell, stopped) and `config`; a new term of the fitness
into `fitness`. Results of the presets are held by `tests/training/expected`: they must not change.
"""
