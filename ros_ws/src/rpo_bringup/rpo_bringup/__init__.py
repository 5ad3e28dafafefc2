# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The running system: final_approach runs all nodes in one process."""
