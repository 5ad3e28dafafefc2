# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The error of the linear model: a flight beside two bodies in the full field of gravity.

`two_body`: the check. `picture`: what it draws. The command is `rpo truth`.
"""
