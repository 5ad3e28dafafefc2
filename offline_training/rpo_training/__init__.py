# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Offline training, campaigns and reports of the final-approach controller."""

__version__ = '0.1.0'
