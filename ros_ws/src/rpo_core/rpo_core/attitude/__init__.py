# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Target and chaser are bodies: how they turn, and motion as it is seen from their axes."""
