# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Keep closed what nobody opened: a node on this machine is not reached from outside.

ROS's discovery range LOCALHOST keeps a node from looking outside. It does not keep one outside from
finding it: who gives its address as a static peer is let in. So a node that is not opened to anyone
listens on the loopback interface alone.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path

RANGE, PEERS = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS'
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
LOOPBACK = Path(__file__).with_name('loopback.xml')


def keep_to_this_machine(env: MutableMapping[str, str] = os.environ) -> None:
    """Bind Fast DDS to this machine where the environment opens it to nobody; before rclpy.init.

    A profile of the user's own is left as it is.
    """
    if env.get(RANGE) != 'LOCALHOST' or env.get(PEERS) or any(env.get(name) for name in PROFILES):
        return
    env[PROFILES[1]] = str(LOOPBACK)
