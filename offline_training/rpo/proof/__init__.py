# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proofs of the closed loop from every start of a box: `rpo prove`. docs/proof.md has the theorem.

`surface` bounds the control surface, `certificate` proves claims of it alone, `proven` has what is
shown of shipped controllers. `enclosure` makes a table of the surface, `tube` moves sets of states
through the ticks, `invariant` finds a set that no flight leaves, `claims` says what follows,
`check` recomputes it in exact arithmetic. The glossary is on that page too.
"""
