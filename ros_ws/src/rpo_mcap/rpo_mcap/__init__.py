# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A run as an MCAP file: its format, its writer, its reader; `rpo_log` makes evidence of it.

What a topic is stands in `rpo_core.wire.interfaces`; `topics` says what a log makes of it.
"""
