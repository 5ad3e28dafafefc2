# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of a flight, bit-equal everywhere: interpreted, or compiled by numba."""
