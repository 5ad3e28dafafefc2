# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a run's log holds: roles, message types, quality of service, order within a tick."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rpo_log.errors import Kind, LogError

CLOCK = 'clock'
STATE = 'relative_state'
NAVIGATION = 'navigation_state'
FORCE = 'control_force'
DISTURBANCE = 'disturbance_force'
APPLIED = 'applied_force'
APPLIED_DISTURBANCE = 'applied_disturbance'
STATUS = 'run_status'

ORDER = (CLOCK, STATE, NAVIGATION, FORCE, DISTURBANCE, APPLIED, APPLIED_DISTURBANCE, STATUS)
"""Roles in the order in which the messages of one tick are written."""

STATES = (STATE, NAVIGATION)
"""Roles whose messages are states: the truth, and what the controller sees if that differs."""

ANSWERS = (NAVIGATION, FORCE, DISTURBANCE)
"""Roles whose messages answer states; in free running they may lack, or come late."""

REQUIRED = (STATE, FORCE)
"""Roles without which a log is not that of a closed loop."""

INFINITE = {'sec': 9223372036, 'nsec': 854775807}
"""rmw's infinite duration, as rosbag2 writes it."""


@dataclass(frozen=True)
class Qos:
    """Quality of service that the publisher of a topic offers, in rosbag2's words (version 9)."""

    reliability: str = 'reliable'
    durability: str = 'volatile'
    depth: int = 64
    history: str = 'keep_last'

    def to_document(self) -> dict[str, Any]:
        """Return the profile in the form of rosbag2 metadata version 9."""
        return {
            'history': self.history,
            'depth': self.depth,
            'reliability': self.reliability,
            'durability': self.durability,
            'deadline': dict(INFINITE),
            'lifespan': dict(INFINITE),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(INFINITE),
            'avoid_ros_namespace_conventions': False,
        }


TYPES = {
    CLOCK: 'rosgraph_msgs/msg/Clock',
    STATE: 'nav_msgs/msg/Odometry',
    NAVIGATION: 'nav_msgs/msg/Odometry',
    FORCE: 'geometry_msgs/msg/WrenchStamped',
    DISTURBANCE: 'geometry_msgs/msg/WrenchStamped',
    APPLIED: 'geometry_msgs/msg/WrenchStamped',
    APPLIED_DISTURBANCE: 'geometry_msgs/msg/WrenchStamped',
    STATUS: 'diagnostic_msgs/msg/DiagnosticStatus',
}
"""ROS type of each role."""

QOS = {
    CLOCK: Qos(),
    STATE: Qos(),
    NAVIGATION: Qos(),
    FORCE: Qos(),
    DISTURBANCE: Qos(),
    APPLIED: Qos(),
    APPLIED_DISTURBANCE: Qos(),
    STATUS: Qos(durability='transient_local', depth=1),
}
"""Quality of service of each role."""


FRAMES = {
    STATE: ('target_lvlh', 'chaser'),
    NAVIGATION: ('target_lvlh', 'chaser'),
    FORCE: ('target_lvlh',),
    DISTURBANCE: ('target_lvlh',),
    APPLIED: ('target_lvlh',),
    APPLIED_DISTURBANCE: ('target_lvlh',),
}
"""Frame ids of each role: that of the header, and the child frame of the state."""


@dataclass(frozen=True)
class Topic:
    """One recorded topic: full name, and the role that its last path component gives it."""

    name: str
    role: str

    @property
    def type(self) -> str:
        """ROS type, like nav_msgs/msg/Odometry."""
        return TYPES[self.role]

    @property
    def qos(self) -> Qos:
        """Offered quality of service."""
        return QOS[self.role]


def free_running(recorded: Iterable[Topic]) -> bool:
    """Return whether the plant kept the wall clock: then it says which force it flew."""
    return any(topic.role == APPLIED for topic in recorded)


def role_of(name: str) -> str | None:
    """Return the role of a topic name, absolute or in a namespace; None if it has none."""
    role = name.rsplit('/', 1)[-1]
    return role if role in TYPES else None


def resolve(names: Iterable[str], path: str = 'topics') -> tuple[Topic, ...]:
    """Return the topics of a run in the order of `ORDER`; raises LogError."""
    found: dict[str, Topic] = {}
    for name in names:
        role = role_of(name)
        if role is None:
            raise LogError(
                Kind.WRONG_TYPE,
                path,
                f'topic {name} has no role in a run; the last '
                f'part of a name must be one of {", ".join(ORDER)}',
            )
        if role in found:
            raise LogError(
                Kind.WRONG_TYPE,
                path,
                f'topics {found[role].name} and {name} have '
                f'the same role, {role}; one run is recorded in one log',
            )
        found[role] = Topic(name, role)
    return tuple(found[role] for role in ORDER if role in found)
