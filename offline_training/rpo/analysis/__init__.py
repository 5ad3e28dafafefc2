# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is, by flights: its targets, its margins, other controllers beside it.

`judgement`: targets, requirements and campaigns. `comparison`, `optimal`, `robustness`: controllers
beside each other, the least energy, margins. `attack`, `attack_campaign`, `assurance`: hostile
commands and counts. `truth`, `consistency`: the error of the linear model, and of filters.
"""
