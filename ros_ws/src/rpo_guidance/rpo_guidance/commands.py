# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

from functools import partial

from rpo_ros.entry_point import start_node

guidance = partial(start_node, 'rpo_guidance.guidance_node')
operator = partial(start_node, 'rpo_guidance.operator_node', interpreted=True)
