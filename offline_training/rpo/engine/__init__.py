# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The lanes of a search: all starts of a candidate side by side, in SIMD registers.

Under Clohessy-Wiltshire z is decoupled from x and y, and most laws act axis by axis. So a flight is
a planar (x, y) and a vertical (z) loop, and a set of starts has few distinct ones. All other
flights fly through `rpo_core.chain.flight.fly`; `tests/training/test_engine.py` compares the bits.
"""
