# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers and their files, the paper's fuzzy system, and why a controller commands a force."""
