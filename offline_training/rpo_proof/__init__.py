# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proofs of the closed loop from every start of a box: `rpo prove`. docs/proof.md has the theorem.

`tables` encloses the control surface, `tube` moves sets of states through the ticks, `rest` shows
that they stay for ever, `claims` says what follows, `check` recomputes it in exact arithmetic.
"""
