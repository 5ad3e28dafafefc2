# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a run's log is: its ticks and its folder, what rosbag2 and MCAP want beside the messages.

Writers and readers both use this. A change here changes the file format: then raise
`rpo_log.format.run.LOG_FORMAT`, and keep reading the older one.
"""
