# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A plant of somebody else: it flies our controller and recorder, one tick an answer.

python plant.py SCENARIO.yaml
"""

import math
import sys

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def status(name, **values):
    pairs = [KeyValue(key=key.replace('__', '.'), value=str(v)) for key, v in values.items()]
    return DiagnosticStatus(name=name, hardware_id='none', values=pairs)


class Plant(Node):
    def __init__(self, text):
        super().__init__('my_plant')
        self.s, self.tick, self.recorder, self.logged = yaml.safe_load(text), 0, '', 0
        self.state = self.s['initial_position_m'] + self.s['initial_velocity_m_s']
        self.mine = status('my_plant', role='plant', file__scenario__yaml=text)
        self.manifest = self.create_publisher(DiagnosticStatus, 'node_manifest', LATCHED)
        self.run_status = self.create_publisher(DiagnosticStatus, 'run_status', LATCHED)
        self.states = self.create_publisher(Odometry, 'relative_state', 64)
        self.create_subscription(WrenchStamped, 'control_force', self.on_force, 64)
        self.create_subscription(DiagnosticStatus, 'recorder_status', self.on_recorder, LATCHED)
        self.create_timer(0.25, self.repeat)  # a message may be lost, or nobody there yet
        self.say('waiting')

    def say(self, phase):
        r, v, self.phase = math.hypot(*self.state[:3]), math.hypot(*self.state[3:]), phase
        said = status('run', phase=phase, tick=self.tick, distance_m=r, speed_m_s=v)
        self.run_status.publish(said)

    def repeat(self):
        self.manifest.publish(self.mine)
        self.send()

    def send(self):
        message = Odometry(child_frame_id='chaser')
        message.header.frame_id, p = 'target_lvlh', message.pose.pose.position
        stamp_ns = round(self.s['epoch'].timestamp()) * 10**9 + self.tick * round(
            self.s['dt_s'] * 1e9
        )
        message.header.stamp, v = Time(nanoseconds=stamp_ns).to_msg(), message.twist.twist.linear
        p.x, p.y, p.z, v.x, v.y, v.z = self.state
        self.stamp = message.header.stamp
        self.states.publish(message)

    def on_recorder(self, said):
        values = {pair.key: pair.value for pair in said.values}
        self.recorder, self.logged = said.message, int(values.get('next_tick', 0))

    def on_force(self, command):
        """Pass the tick that the command answers; of the last one only the command is needed."""
        behind = self.recorder != 'ready' or self.tick - self.logged >= 48
        if behind or command.header.stamp != self.stamp or self.phase == 'finished':
            return  # the repeated state is answered again
        if self.phase == 'waiting':
            self.say('running')
        if self.tick == round(self.s['duration_s'] / self.s['dt_s']):
            self.say('finished')
            return
        (x, y, z, vx, vy, vz), dt, f = self.state, self.s['dt_s'], command.wrench.force
        n, m = math.sqrt(3.986004418e14 / self.s['orbit_radius_m'] ** 3), self.s['mass_kg']
        vx += dt * (3 * n * n * x + 2 * n * vy + f.x / m)
        vy += dt * (-2 * n * vx + f.y / m)
        vz += dt * (-n * n * z + f.z / m)
        self.state, self.tick = [x + dt * vx, y + dt * vy, z + dt * vz, vx, vy, vz], self.tick + 1
        self.send()


def fly(kind):
    rclpy.init()
    with open(sys.argv[1]) as file:
        plant = kind(file.read())
    while (plant.phase, plant.recorder) != ('finished', 'closed'):
        rclpy.spin_once(plant)
    return plant


if __name__ == '__main__':
    fly(Plant)
