# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Search of fuzzy controllers: genes, searches by ask and tell, fitness, runs in their folders.

Add a search to `algorithms` (ask, tell, stopped) and `config`, a term of the fitness to `fitness`.
The results of the presets in `tests/training/expected` must not change.
"""
