# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is: targets, comparisons, and the least energy that physics allows."""
