# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Measurement programs and page generators of this checkout; no flight software, not installed."""
