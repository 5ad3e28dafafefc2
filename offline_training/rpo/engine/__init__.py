# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo engine: many flights of one controller side by side, in SIMD lanes.

`lanes`: the scratch, and fuzzy inference over it. `parts`: what each stage adds to the tick.
`tick`: the order of kernels, and how a part is registered. `calls`: kernels by their address.
`counters`: metrics during the flight. `cases`: flights that run together. `simulator`: the threads.
`support`: what the engine knows; other flights run one by one through `rpo_core.chain.flight.fly`.

A change of the tick must keep the bits of `fly`; `tests/training/test_engine.py` compares them.
"""
