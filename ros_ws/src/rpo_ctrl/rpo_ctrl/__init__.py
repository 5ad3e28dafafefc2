# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers beside the paper's fuzzy system, the controller node, and the files that ship."""
