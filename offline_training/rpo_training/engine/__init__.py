# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo engine: many flights of one controller side by side, in SIMD lanes.

`lanes`: the scratch, and fuzzy inference over it. `parts`: what a run is made of. `tick`: the tick,
lane by lane. `counters`: metrics while it flies. `cases`, `simulator`: what is flown together, and
the threads that fly it. `support`: what the engine knows; the rest flies through
`rpo_core.flight.fly`, one by one.

Whoever changes the tick keeps the bits of `fly`: `tests/training/test_engine.py` holds them.
"""
