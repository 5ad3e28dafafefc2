# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proofs and warnings about a fuzzy rule base, without flying it.

`surface`: enclosures of the control surface. `certificate`: the claims proven with them.
`rule_base`: holes, idle rules, wrong order.
"""
