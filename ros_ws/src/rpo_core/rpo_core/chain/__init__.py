# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The chain of stages: the tick of a flight, written once; flights without ROS."""
