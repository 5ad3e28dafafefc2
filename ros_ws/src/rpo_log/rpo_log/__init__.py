# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs as evidence: MCAP writing, reading and verifying without ROS; the recorder node."""
