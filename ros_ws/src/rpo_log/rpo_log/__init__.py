# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs as evidence: recorded, verified, signed, compared, exported, repaired, replayed."""
