# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from rpo_cli.commands import shared
from rpo_cli.commands.shared import Controller, NoFail, SameScenario, Set, echo, end
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.files.validation import InputError


def simulate(
    scenario: Annotated[str, Argument(help='shipped name or file  [approach]')] = '',
    named: SameScenario = '',
    controller: Controller = DEFAULT_CONTROLLER,
    changes: Set = None,
    csv: Annotated[Path | None, Option(help='write states, forces, attitudes')] = None,
    output: Annotated[
        Path | None, Option('--output', '-o', help='run folder: a log, as of the ROS 2 recorder')
    ] = None,
    overwrite: Annotated[bool, Option('--overwrite', help='replace the run in a folder')] = False,
    span: Annotated[
        str,
        Option(
            '--sweep',
            metavar='KEY=FROM:TO:NUMBER',
            help='fly so many values of a field: one table, one picture in --output',
        ),
    ] = '',
    no_fail: NoFail = False,
) -> None:
    """Fly one scenario without ROS: the bits that the nodes fly, and their metrics.

    Exit code 1: a requirement of the scenario is missed.
    """
    import yaml

    from rpo_attitude import turns
    from rpo_core import files
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import load_controller
    from rpo_core.files import overrides
    from rpo_core.files.scenario import text_for_logs
    from rpo_core.judge.verdicts import missed
    from rpo_ctrl import similarity
    from rpo_log.show.report import print_table
    from rpo_log.tools.record import record
    from rpo_mcap.format.run import CONTROLLER, PARAMETERS, SCENARIO

    chosen, loaded = shared.chosen_scenario(scenario, named), load_controller(controller)
    changes = changes or []
    if span:
        from rpo_cli.commands.sweep import sweep

        if csv or overwrite:
            raise InputError('`--sweep` writes a picture: no `--csv` and no `--overwrite`')
        end(sweep(chosen, loaded, changes, span, output), no_fail)
        return
    flown = overrides.load(chosen, changes)
    flight = fly(flown, loaded)
    print_table(flight, f'{flown.name}, controller {controller}')
    again = similarity.command(controller, chosen, changes)
    for line in (turns.too_fast(flight), similarity.hint(flight, loaded, again)):
        if line:
            echo(line)
    if csv:
        shared.write_flight(flight, csv)
    if output:
        named_by = {'scenario': chosen, 'controller': controller, 'set': changes}
        texts = {
            SCENARIO: text_for_logs(overrides.text_of(chosen, changes), flown),
            CONTROLLER: files.read_text(files.find('controller', controller)),
            PARAMETERS: yaml.safe_dump({'simulate': named_by}),
        }
        attached = {name: text.encode() for name, text in texts.items()}
        echo(f'{output}: {record(flight, attached, output, overwrite=overwrite).sentence()}')
    end(missed(flight), no_fail)
