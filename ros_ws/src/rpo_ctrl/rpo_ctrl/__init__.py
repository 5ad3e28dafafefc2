# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The fuzzy controller node and the trained controller files that ship."""
