# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`final_approach`: all nodes of a scenario and the recorder in one process."""

from __future__ import annotations

import argparse
import datetime
import sys
import tempfile
import time
from pathlib import Path

from rclpy.utilities import remove_ros_args

from rpo_bringup.commands import parser
from rpo_bringup.flight_software_node import needed
from rpo_core.files.validation import InputError, real
from rpo_core.judge.similarity import command
from rpo_core.scenario import overrides, scenario
from rpo_core.wire.statuses import FINISHED
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.show import report
from rpo_ros.entry_point import EXIT_INTERRUPTED
from rpo_ros.running import EXIT_BAD_INPUT, FlightNode, run
from rpo_sim.plant_node import PlantNode


def _nodes(options: argparse.Namespace, output: str) -> list[FlightNode]:
    chosen = scenario.load_scenario(options.scenario)
    named = {'scenario': options.scenario}
    plant = {
        **named,
        'real_time_factor': real('real_time_factor', options.real_time_factor, least=0.0),
        'wait_for_recorder': True,
        'start_timeout_s': real('start_timeout_s', options.start_timeout_s, least=0.0),
    }
    nodes: list[FlightNode] = [
        PlantNode(plant),
        ControllerNode({**named, 'controller': options.controller}),
    ]
    nodes.extend(kind(named) for kind in needed(chosen))
    # Last, because it makes the run folder: if another node fails, no folder is left behind.
    recorder = {'output': output, 'overwrite': options.overwrite, 'sign_key': options.sign}
    nodes.append(RecorderNode(recorder))
    return nodes


def _report(folder: Path, plant: PlantNode, wall_s: float, scale: str) -> bool:
    """Print and draw a recorded flight; return whether it misses a requirement."""
    duration_s = plant.scenario.duration_s
    print(f'simulated {duration_s:g} s in {wall_s:.2f} s, start included: {folder}')
    picture, missed = report.show(folder, scale)
    print(picture or 'no picture: matplotlib is missing (apt: python3-matplotlib; pip: matplotlib)')
    return missed


def main() -> int:
    """Entry point of `ros2 run rpo_bringup final_approach`."""
    options = parser().parse_args(remove_ros_args(sys.argv)[1:])
    scale = command(options.controller, options.scenario, options.set or ())
    now = datetime.datetime.now().strftime('%Y%m%d-%H%M%S')
    output = options.output or f'runs/{Path(options.scenario).stem}-{now}'
    begun = time.monotonic()
    nodes: list[FlightNode] = []

    def make() -> list[FlightNode]:
        if options.set:
            changed.write_text(overrides.text_of(options.scenario, options.set), 'utf-8')
            options.scenario = str(changed)
        nodes.extend(_nodes(options, output))
        return nodes

    with tempfile.TemporaryDirectory() as temporary:
        changed = Path(temporary) / 'scenario.yaml'
        # The first node is the plant, the last the recorder.
        code = run(
            make,
            sys.argv,
            lambda made: made[0].done and made[-1].done,
            interrupted=EXIT_INTERRUPTED,
        )
    if code == EXIT_INTERRUPTED:
        return code
    if code and nodes and nodes[-1].log is None:
        code = nodes[-1].exit_code or code  # the plant gave up because there is no place for a log
    if nodes and nodes[0].phase == FINISHED:
        missed = bool(nodes[0].exit_code)  # a keep-out zone was entered: no report is needed
        code = next((node.exit_code for node in nodes[1:] if node.exit_code), 0)
        try:
            if code == 0 and not options.no_report:
                missed |= _report(nodes[-1].folder, nodes[0], time.monotonic() - begun, scale)
        except InputError as error:
            print(error, file=sys.stderr)
            return EXIT_BAD_INPUT
        code = code or int(missed and not options.no_fail)
    return code


if __name__ == '__main__':
    sys.exit(main())
