# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the recorder."""

from rpo_ros.parameter_rows import tables

RECORDER = tables('rpo_log')['recorder']
