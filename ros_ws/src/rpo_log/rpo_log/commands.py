# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

from functools import partial

from rpo_log.log_commands import main
from rpo_ros.entry_point import start_node

recorder = partial(start_node, 'rpo_log.recorder_node')
replay = partial(start_node, 'rpo_log.replay_node')
verify, info = partial(main, 'verify'), partial(main, 'info')
