# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The mathematics of the final approach, without ROS; one folder a subject.

`kernels`: arithmetic with the same bits everywhere. `files`: YAML, checked. `wire`: topics and
their bytes. `stage`: the contract of all stages. `world`: what moves, and the zones around the
target. `scenario`: the file that says all of a flight. `attitude`, `control`, `thrusters`,
`navigation`, `guidance`, `assurance`: stages. `chain`: the tick, and flights. `judge`: metrics and
verdicts. `shipped`: scenarios and controllers. A folder imports only those named before it.
"""

from rpo_core import plugins

plugins.MODULES += [
    f'rpo_core.{room}.stages'
    for room in (
        'world', 'thrusters', 'control', 'navigation', 'attitude', 'guidance', 'assurance'
    )
]  # fmt: skip
