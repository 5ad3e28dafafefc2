# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

from functools import partial

from rpo_ros.entry_point import start_node

visualizer = partial(start_node, 'rpo_view.visualizer_node')
web = partial(start_node, 'rpo_view.web_node')
