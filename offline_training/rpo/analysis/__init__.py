# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is: scores, comparisons, bounds, trials of its safety, its rules.

`scoring`: conditions and fitness, which a search minimises. `evaluation`: targets, comparisons, the
least energy. `analysis`: the rule base without a flight. `safety`: hostile trials. `truth`: the
error of the linear model.
"""
