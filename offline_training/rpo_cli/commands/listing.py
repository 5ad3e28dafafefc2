# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo list`, and the names that a shell completes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, get_type_hints

from typer import Argument

from rpo_cli.display import plain_console
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

NAMED = {
    **dict.fromkeys(('scenario', 'named', 'subject', 'estimator'), 'scenario'),
    **dict.fromkeys(('controller', 'controllers', 'target'), 'controller'),
    **dict.fromkeys(('campaign', 'source'), 'campaign'),
}
"""Parameter of a command -> the kind of files whose names a shell completes there."""


def list_(what: Annotated[str, Argument(help=f'{", ".join(KINDS)}  [all]')] = '') -> None:
    """Print the names of what ships: scenarios, plans, controllers, campaigns."""
    console = plain_console()
    for kind in [choice('what', what, KINDS)] if what else KINDS:
        console.print(kind, style='bold')
        for name, path in files.shipped(KINDS[kind]).items():
            document = files.parse_yaml(files.read_text(path))
            if KINDS[kind] == 'scenario' and ('guidance' in document) is not (kind == 'plans'):
                continue
            about = document.get('description') or 'no description'
            if 'runs' in document:
                runs, controller, scenario = map(document.get, ('runs', 'controller', 'scenario'))
                about = f'{runs} runs of {controller} in {scenario}'
            console.print(f'  {name:22s}{printable(about)}', soft_wrap=True)


def complete_names(command: Callable[..., None]) -> None:
    """Let a shell complete names of files in the parameters of a command, see `NAMED`."""
    hints: dict[str, Any] = get_type_hints(command, include_extras=True)
    for name, kind in NAMED.items():
        for option in getattr(hints.get(name), '__metadata__', ()):
            option.autocompletion = _names_of(kind)
    command.__annotations__ = hints


def _names_of(kind: str) -> Callable[[str], list[str]]:
    return lambda incomplete: [n for n in files.shipped(kind) if n.startswith(incomplete)]
