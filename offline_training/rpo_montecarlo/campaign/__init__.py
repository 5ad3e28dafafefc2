# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns of dispersed closed loops: how often a controller succeeds, and how surely.

`config`: dispersions. `sampling`: the draws of each run. `run_batch`: runs on the engine, or one by
one. `single`: one run as a scenario. `execution`, `store`: units of runs into a folder.
`statistics`, `sweep`: rates and distributions of the results.

A new quantity to disperse goes into `quantities.QUANTITIES`, `sampling.draw` and both `run_batch`
and `single`: a test holds the two to the same bits. Columns of results are a file format.
"""
