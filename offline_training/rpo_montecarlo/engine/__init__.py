# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo engine: many flights of one controller side by side, in SIMD lanes.

`lanes`: the scratch, and fuzzy inference over it. `parts`: the parts of a run. `tick`: the tick,
lane by lane. `counters`: metrics during the flight. `cases`: flights that run together.
`simulator`: the threads. `support`: what the engine knows; other flights run one by one through
`rpo_core.chain.flight.fly`.

A change of the tick must keep the bits of `fly`; `tests/training/test_engine.py` compares them.
"""
