# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Search of controllers: genes, searches by ask and tell, runs in folders, tuning of baselines.

Add a search to `algorithms` (ask, tell, stopped) and `config`. A new baseline needs its law in
`rpo_ctrl` and its space in `tuning`. `gym` is the environment for learning controllers.
"""
