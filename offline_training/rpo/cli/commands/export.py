# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo export` and `rpo import`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import echo, write_texts
from rpo_core.files.validation import InputError


def export(
    controller: Annotated[str, Argument(help='shipped name or file')],
    to: Annotated[str, Option(help='fis (MATLAB), fll (FuzzyLite), json or c')],
    output: Annotated[
        Path | None,
        Option('--output', '-o', help='file, - for the terminal  [named after the controller]'),
    ] = None,
    assurance: Annotated[
        str | None,
        Option(
            metavar='SCENARIO',
            help='with c: the assurance filter of a scenario too, shipped name or file',
        ),
    ] = None,
) -> None:
    """Write a controller for MATLAB or FuzzyLite, as JSON or C99.

    The C function needs nothing else, and gives the bits of the flown controller. The header beside
    the C file shows how to call and compile it.
    """
    from rpo.exports import attitude_files, c, c_assured, text_of
    from rpo.montecarlo.outputs import identifier, make_folder
    from rpo_core.control import attitude
    from rpo_core.control.controller import load_controller
    from rpo_core.scenario.scenario import load_scenario

    axis = attitude.axis_of(controller) if attitude.is_one(controller) else None
    if axis is not None and (to != 'c' or assurance is not None):
        raise InputError('a controller of attitude needs `--to c`, without `--assurance`')
    if assurance is not None and to != 'c':
        raise InputError(f'`--assurance` needs `--to c`; got {to}')
    loaded = load_controller(controller) if axis is None else axis
    path = output or Path(f'{identifier(loaded.name)}.{to}')
    texts: tuple[str, ...]
    if assurance is not None:
        texts = c_assured.files(loaded, load_scenario(assurance), path.name)
    elif axis is not None:
        texts = attitude_files(axis, path.name)
    elif to == 'c':
        texts = c.files(loaded, path.name)
    else:
        texts = (text_of(loaded, to),)
    if output == Path('-'):
        typer.echo(texts[0], nl=False)
        return
    make_folder(path.parent)
    write_texts(dict(zip((path, path.with_suffix('.h')), texts, strict=False)))


_HELP = 'of an error (force) of 1, if the file does not say'


def import_(
    file: Annotated[Path, Argument(help='.fis or .fll file')],
    output: Annotated[Path, Option('--output', '-o', help='controller file to write')],
    position_scale: Annotated[float | None, Option(help=f'metres {_HELP}')] = None,
    velocity_scale: Annotated[float | None, Option(help=f'm/s {_HELP}')] = None,
    force_scale: Annotated[float | None, Option(help=f'newtons {_HELP}')] = None,
) -> None:
    """Make a controller file from a MATLAB .fis or FuzzyLite .fll file of the paper's shape.

    Two inputs and one output of five mirrored triangles each, 25 rules, min-max, centroid.
    """
    from rpo.analysis.rule_base import warnings
    from rpo.exports.importing import load
    from rpo_core.control.controller import dumps

    loaded = replace(load(file, (position_scale, velocity_scale, force_scale)), name=output.stem)
    write_texts({output: dumps(loaded)})
    for warning in warnings(loaded.system):
        echo(f'warning: {warning}', err=True)
