# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; without ROS, so that `--help` is quick."""

import argparse
import sys
from functools import partial

from rpo_core.files import DEFAULT_CONTROLLER, DEFAULT_SCENARIO
from rpo_core.files.output import standard_output
from rpo_ros.entry_point import EXIT_BAD_INPUT, EXIT_INTERRUPTED, asks_for_help, start, start_node
from rpo_ros.parameter_rows import refusal, tables

_NODES = (
    ('rpo_sim', 'plant'),
    ('rpo_ctrl', 'fuzzy_controller'),
    ('rpo_sim', 'disturbance_injector'),
    ('rpo_ctrl', 'navigation'),
    ('rpo_log', 'recorder'),
)
"""Nodes that `final_approach` runs."""

_EXAMPLE = """example:
  ros2 run rpo_bringup final_approach --scenario paper_test --output runs/first
  ros2 run rpo_bringup final_approach --set 'initial_position_m=[0,80,0]'

exit code: 0 complete run, complete log, no requirement missed; 1 a requirement is missed (without
a report: a keep-out zone was entered), or the log is not complete; 2 bad input; 3 aborted;
130 interrupted by a signal
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    words = argparse.ArgumentParser(
        prog='final_approach',
        description='Fly a scenario with all its nodes in one process.',
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    words.add_argument(
        '--scenario', default=DEFAULT_SCENARIO, help='shipped name or path (%(default)s)'
    )
    words.add_argument(
        '--controller', default=DEFAULT_CONTROLLER, help='shipped name or path (%(default)s)'
    )
    words.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='KEY=VALUE',
        help='change a field of the scenario, like initial_position_m=[0,80,0]; repeatable',
    )
    words.add_argument('--output', help='run folder (runs/<scenario>-<date>-<time>)')
    words.add_argument(
        '--overwrite', action='store_true', help='replace the run in an existing folder'
    )
    words.add_argument(
        '--sign', default='', metavar='KEY', help='private key in PEM, which signs the run folder'
    )
    words.add_argument(
        '--real-time-factor',
        default=0.0,
        type=float,
        metavar='X',
        help='simulated seconds per second; 0: as fast as it goes (default)',
    )
    words.add_argument(
        '--start-timeout-s',
        default=30.0,
        type=float,
        metavar='S',
        help='wall time to wait for all nodes before tick 0 (%(default)s); 0: for ever',
    )
    words.add_argument(
        '--no-fail', action='store_true', help='exit code 0 although a requirement is missed'
    )
    words.add_argument(
        '--no-report',
        action='store_true',
        help='write the log only: no report, no verdicts but on keep-out zones',
    )
    return words


@standard_output()
def final_approach() -> int:
    """Run `ros2 run rpo_bringup final_approach`; answer `--help` without ROS."""
    if asks_for_help():
        parser().parse_args(['--help'])
    rows = [row for package, node in _NODES for row in tables(package)[node]]
    if sentence := refusal(sys.argv, rows, 'ros2 run rpo_bringup final_approach'):
        print(sentence, file=sys.stderr)
        return EXIT_BAD_INPUT
    return start('rpo_bringup.final_approach', EXIT_INTERRUPTED)


def flight_software() -> int:
    """Run `ros2 run rpo_bringup flight_software`."""
    return start_node('rpo_bringup.flight_software_node')


visualizer = partial(start_node, 'rpo_bringup.visualizer_node')
web = partial(start_node, 'rpo_bringup.web_node')


def ping_pong() -> int:
    """Run `ros2 run rpo_bringup ping_pong`, the peer of `rpo bench ros`."""
    return start('rpo_bringup.ping_pong', EXIT_INTERRUPTED)
