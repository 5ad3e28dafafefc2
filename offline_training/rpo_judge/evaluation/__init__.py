# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is: targets, comparisons, and the least energy that physics allows.

`assessment`: targets Q1-Q5. `comparison`, `comparison_table`: all controllers beside each other.
`judgement`: requirements, campaigns. `optimal`: convex programs.
`robustness`: margins of the loop.
"""
