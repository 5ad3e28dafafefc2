# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from rpo.cli.commands.shared import Controller, NoFail, Set, echo, end
from rpo_core.files import DEFAULT_CONTROLLER, DEFAULT_SCENARIO


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
    import yaml

    from rpo_core import files
    from rpo_core.attitude import turns
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import load_controller
    from rpo_core.judge import similarity
    from rpo_core.judge.verdicts import missed
    from rpo_core.scenario import overrides
    from rpo_core.scenario.scenario import text_for_logs
    from rpo_core.wire.interfaces import CHASER_ATTITUDE
    from rpo_log.format.run import CONTROLLER, PARAMETERS, SCENARIO
    from rpo_log.show.report import print_table
    from rpo_log.tools.record import record

    loaded, changes = load_controller(controller), changes or []
    flown = overrides.load(scenario, changes)
    flight = fly(flown, loaded)
    print_table(flight, f'{flown.name}, controller {controller}')
    again = similarity.command(controller, scenario, changes)
    attitudes = flight.signals.get(CHASER_ATTITUDE)
    fast = '' if attitudes is None else turns.too_fast(attitudes, flight.scenario.dt_s)
    for line in (fast, similarity.hint(flight, loaded, again)):
        if line:
            echo(line)
    if output:
        named_by = {'scenario': scenario, 'controller': controller, 'set': changes}
        texts = {
            SCENARIO: text_for_logs(overrides.text_of(scenario, changes), flown),
            CONTROLLER: files.read_text(files.find('controller', controller)),
            PARAMETERS: yaml.safe_dump({'simulate': named_by}),
        }
        attached = {name: text.encode() for name, text in texts.items()}
        echo(f'{output}: {record(flight, attached, output, overwrite=overwrite).sentence()}')
    end(missed(flight), no_fail)
