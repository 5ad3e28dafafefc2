# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The mathematics of the final approach: relative motion, inference, scenarios, metrics."""
