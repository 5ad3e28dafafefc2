# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo watch`: a run of ROS 2 nodes, live on this terminal."""

from __future__ import annotations

import os
import shutil
from typing import Annotated

import typer

from rpo_core.files.validation import InputError

EXAMPLES = 'Example: `rpo watch` beside `ros2 run rpo_sim plant`'


def watch(
    namespace: Annotated[str, typer.Option(help='of the run to watch')] = '/',
    until_end: Annotated[bool, typer.Option(help='leave when the run has ended')] = False,
) -> None:
    """Watch a run of ROS 2 nodes: range, rates, force bars, the rules that act; Ctrl-C leaves."""
    ros2 = shutil.which('ros2')
    if ros2 is None:
        raise InputError('`ros2` is not on the PATH: `source ros_ws/env.bash` in this shell first')
    command = [
        ros2,
        'run',
        'rpo_view',
        'watch',
        '--ros-args',
        '-r',
        f'__ns:=/{namespace.strip("/")}',
    ]
    os.execv(ros2, [*command, '-p', f'until_end:={str(until_end).lower()}'])
