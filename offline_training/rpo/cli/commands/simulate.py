# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from rpo.cli.commands.shared import Controller, NoFail, Set, echo, end
from rpo.display import print_table
from rpo_core.files import DEFAULT_CONTROLLER, DEFAULT_SCENARIO

LONG_TICKS = 30_000
"""A flight of more ticks may take longer in Python than its kernels take to compile."""

FIRST_FLIGHT = (
    'No kernel is compiled yet: this flight was computed in Python, with the same bits. '
    'The next command compiles what it needs, once, which may take a minute.'
)


def simulate(
    scenario: Annotated[str, Argument(help='shipped name or file')] = DEFAULT_SCENARIO,
    controller: Controller = DEFAULT_CONTROLLER,
    changes: Set = None,
    output: Annotated[
        Path | None, Option('--output', '-o', help='run folder: a log, as of the ROS 2 recorder')
    ] = None,
    overwrite: Annotated[bool, Option('--overwrite', help='replace the run in a folder')] = False,
    no_fail: NoFail = False,
) -> None:
    """Fly one scenario without ROS: the bits that the nodes fly, and their metrics.

    Exit code 1: a requirement of the scenario is missed.
    """
    from rpo.door.flight import flown
    from rpo.door.subjects import scenario_source
    from rpo_core.attitude import pointing
    from rpo_core.judge import similarity
    from rpo_core.kernels import jit
    from rpo_core.scenario import overrides
    from rpo_core.wire.interfaces import CHASER_ATTITUDE
    from rpo_log.show import report

    changes = changes or []
    fields = overrides.read(changes)
    if jit.FIRST_FLIGHT:
        _prepare_first_flight(scenario_source(scenario, fields).subject.ticks)
    flight = flown(scenario, controller, fields)
    print_table(
        report.COLUMNS, report.table(flight), f'{flight.scenario.name}, controller {controller}'
    )
    again = similarity.command(controller, scenario, changes)
    attitudes = flight.signals.get(CHASER_ATTITUDE)
    fast = '' if attitudes is None else pointing.too_fast(attitudes, flight.scenario.dt_s)
    for line in (fast, similarity.hint(flight, flight.controller, again)):
        if line:
            echo(line)
    if output:
        echo(f'{output}: {flight.save(output, overwrite)}')
    if jit.FIRST_FLIGHT:
        echo(FIRST_FLIGHT, err=True)
    end(not flight.ok, no_fail)


def _prepare_first_flight(ticks: int) -> None:
    """Let the next command compile the kernels; a long flight does it now."""
    from rpo_core.kernels import compile_cache

    compile_cache.folder()
    if ticks > LONG_TICKS:
        again = [sys.executable, *sys.orig_argv[1:]]
        os.execve(sys.executable, again, {**os.environ, 'RPO_JIT': '1'})
