# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of somebody else in the chain, each a function from message to message.

python answers.py controller | disturbance | sensor | estimator | guidance | assurance
"""

import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile


def law(state):
    """Return a PD command; the header says which state it answers."""
    position, velocity = state.pose.pose.position, state.twist.twist.linear
    command = WrenchStamped(header=state.header)
    for axis in 'xyz':
        force = -0.008 * getattr(position, axis) - 0.6 * getattr(velocity, axis)
        setattr(command.wrench.force, axis, force)
    return command


def push(state):
    """Return a constant disturbance of 5 mN."""
    force = WrenchStamped(header=state.header)
    force.wrench.force.x = 0.005
    return force


def measure(state):
    """Return a position 1 cm off, with its covariance; -1: no velocity is measured."""
    state.pose.pose.position.y += 0.01
    for axis in range(3):
        state.pose.covariance[7 * axis] = 0.01**2
    state.twist.covariance[0] = -1.0
    return state


def hold(state):
    """Return a reference at rest, 50 m behind the target."""
    found = Odometry(header=state.header, child_frame_id=state.child_frame_id)
    found.pose.pose.position.y = -50.0
    return found


def believe(measurement):
    """Return the measurement as the state."""
    return measurement


def halve(command):
    """Return a more careful command."""
    for axis in 'xyz':
        setattr(command.wrench.force, axis, 0.5 * getattr(command.wrench.force, axis))
    return command


def nothing(state):
    """Return no force."""
    return WrenchStamped(header=state.header)


ROLES = {  # role: topic that it hears; topic -> function for each that it answers with
    'controller': ('relative_state', {'control_force': law}),
    'disturbance': ('relative_state', {'disturbance_force': push}),
    'sensor': ('relative_state', {'measurement': measure}),
    'estimator': ('measurement', {'navigation_state': believe}),
    'guidance': ('relative_state', {'reference_state': hold, 'reference_force': nothing}),
    'assurance': ('control_force', {'assured_force': halve}),
}


class Answers(Node):
    def __init__(self, role):
        super().__init__(f'my_{role}')
        hears, self.answers = ROLES[role]
        self.out = {name: self.create_publisher(kind(name), name, 64) for name in self.answers}
        self.create_subscription(kind(hears), hears, self.answer, 64)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.manifest = self.create_publisher(DiagnosticStatus, 'node_manifest', latched)
        values = [KeyValue(key='role', value=role)]
        self.mine = DiagnosticStatus(name=self.get_name(), values=values)
        self.create_timer(1.0, lambda: self.manifest.publish(self.mine))

    def answer(self, message):
        for name, function in self.answers.items():
            self.out[name].publish(function(message))


def kind(topic):
    return WrenchStamped if topic.endswith('force') else Odometry


rclpy.init()
try:
    rclpy.spin(Answers(sys.argv[1]))
except (KeyboardInterrupt, ExternalShutdownException):
    pass
