# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo engine: many flights of one controller side by side, in SIMD lanes.

`lanes`: the layout of the scratch, and fuzzy inference over it. `tick`: the tick of a flight, lane
by lane, in parts that a flight may lack. `cases`, `simulator`: what is flown together, and the
threads that fly it. `support`: what the engine knows; the rest flies through `rpo_core.flight.fly`.

Whoever changes the tick keeps the bits of `fly`: `tests/training/test_engine.py` holds them.
"""
