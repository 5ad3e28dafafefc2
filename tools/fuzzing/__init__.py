# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile messages, calls and parameters against every node while a flight runs."""
