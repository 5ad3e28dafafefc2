# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The mathematics of the final approach, without ROS.

`chain`: stages, the tick, flights. `world`: what moves. `control`: controllers. `files`: scenarios
and checks. `judge`: metrics and verdicts. `wire`: topics and their bytes.
"""
