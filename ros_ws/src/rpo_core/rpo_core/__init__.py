# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The mathematics of the final approach, without ROS; one folder a subject.

`files`: YAML, checked. `kernels`: arithmetic with the same bits everywhere. `wire`: topics and
their bytes. `stage`: the contract of all stages. `world`: what moves, and the zones around the
target. `scenario`: the file that says all of a flight. `attitude`, `control`, `thrusters`,
`navigation`, `guidance`, `assurance`: stages. `chain`: the tick, and flights. `judge`: metrics and
verdicts. `shipped`: scenarios and controllers. A folder imports only those named before it.
"""

from rpo_core import plugins

plugins.MODULES += [
    f'rpo_core.{module}'
    for module in (
        'world.dynamics',
        'thrusters.thrusters',
        'control.attitude',
        'control.baselines',
        'control.table',
        'control.time_to_go',
        'navigation.attitude_estimator',
        'navigation.attitude_sensors',
        'navigation.estimator',
        'navigation.sensors',
        'attitude.chaser',
        'attitude.pointing',
        'attitude.target',
        'guidance.guidance',
        'assurance.shaping',
        'assurance.assurance',
    )
]
