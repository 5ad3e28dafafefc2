# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Ends the launch with exit code 1 when a flight node fails; stock launch would end with 0.

`ros2 launch` has only the exit codes 0 and 1, and 1 needs an error raised within the launch: this
file raises one. The node's own exit code is in the message.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events.process import ProcessExited

FLIGHT_NODES = (
    'plant',
    'attitude_controller',
    'fuzzy_controller',
    'rival_controller',
    'navigation',
    'guidance',
    'assurance',
    'disturbance_injector',
    'recorder',
    'replay',
)


def _check(event: ProcessExited, context: LaunchContext) -> None:
    name = event.process_name.rpartition('-')[0]
    if event.returncode and name in FLIGHT_NODES:
        raise RuntimeError(f'{name} ended with exit code {event.returncode}')


def generate_launch_description() -> LaunchDescription:
    """Return a check of the exit codes of all processes of the launch."""
    return LaunchDescription([RegisterEventHandler(OnProcessExit(on_exit=_check))])
