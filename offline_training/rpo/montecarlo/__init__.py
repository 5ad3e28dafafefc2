# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Many flights at once: the engine, campaigns of dispersed flights, and clusters.

`engine`: flights side by side, in SIMD lanes. `campaign`: dispersed runs and their statistics.
`pool`: the same work on threads, or on other machines.
"""
