# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpo_cli.commands.shared import echo

EXAMPLES = """
Examples: `rpo import handmade.fis --output mine.yaml` |
`rpo import tuned.fll -o tuned.yaml --position-scale 70 --velocity-scale 0.9 --force-scale 0.5`
"""

_HELP = 'of an error (force) of 1, if the file does not say'


def import_controller(
    file: Annotated[Path, typer.Argument(help='.fis or .fll file')],
    output: Annotated[Path, typer.Option('--output', '-o', help='controller file to write')],
    position_scale: Annotated[float | None, typer.Option(help=f'metres {_HELP}')] = None,
    velocity_scale: Annotated[float | None, typer.Option(help=f'm/s {_HELP}')] = None,
    force_scale: Annotated[float | None, typer.Option(help=f'newtons {_HELP}')] = None,
) -> None:
    """Make a controller file from a MATLAB .fis or FuzzyLite .fll file of the paper's shape.

    Two inputs and one output of five mirrored triangles each, 25 rules, min-max, centroid.
    """
    from dataclasses import replace

    from rpo_core.control.controller import dumps
    from rpo_export.importing import load
    from rpo_judge.analysis.rule_base import warnings
    from rpo_montecarlo.outputs import writing

    loaded = replace(load(file, (position_scale, velocity_scale, force_scale)), name=output.stem)
    with writing(output):
        output.write_text(dumps(loaded), encoding='utf-8')
    for warning in warnings(loaded.system):
        echo(f'warning: {warning}', err=True)
    echo(output)
