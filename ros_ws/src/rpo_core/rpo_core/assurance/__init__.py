# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runtime assurance: no command leads into the keep-out zone, whoever gives it."""
