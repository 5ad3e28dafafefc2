# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns: dispersed flights on the threads of this machine or on a cluster; statistics."""
