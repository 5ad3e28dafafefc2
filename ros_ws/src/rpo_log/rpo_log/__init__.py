# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs as evidence: MCAP writing, reading and verifying; the nodes `recorder` and `replay`.

- `format`: what a run's log is: its ticks, its folder, rosbag2's metadata, message definitions;
- `write`: messages in any order in, the same bytes for the same run out;
- `read`: records, messages, blocks of ticks, the whole log in memory;
- `verify`: each stage of the flight recomputed and compared;
- `tools`: what `rpo log` does: info, diff, export, repair;
- `show`: the table and the picture of a run, and the style of every picture;
- `recorder_node`, `replay_node`: all that knows ROS.

What a topic is stands in `rpo_core.wire.interfaces`; `topics` and `events` say what a log makes of
it.
"""
