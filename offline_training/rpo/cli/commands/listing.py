# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo list`."""

from __future__ import annotations

from typing import Annotated

from typer import Argument

from rpo.cli.display import plain_console
from rpo_core import files
from rpo_core.files.validation import choice, printable

KINDS = {
    'scenarios': 'scenario',
    'plans': 'scenario',
    'controllers': 'controller',
    'attitude_controllers': 'attitude_controller',
    'campaigns': 'campaign',
}
"""What is listed -> the kind of its files; a plan is a scenario with a section `guidance`."""


def list_(what: Annotated[str, Argument(help=f'{", ".join(KINDS)}  [all]')] = '') -> None:
    """Print the names of what ships: scenarios, plans, controllers, campaigns."""
    console = plain_console()
    for kind in [choice('what', what, KINDS)] if what else KINDS:
        console.print(kind, style='bold')
        for name, (about, document) in files.described(KINDS[kind]).items():
            if KINDS[kind] == 'scenario' and ('guidance' in document) is not (kind == 'plans'):
                continue
            console.print(f'  {name:22s}{printable(about)}', soft_wrap=True)
