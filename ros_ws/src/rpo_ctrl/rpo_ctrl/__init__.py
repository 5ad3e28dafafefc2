# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes that fly the chaser."""
