# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo list`, and the names that a shell completes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

from rpo_cli.display import plain_console
from rpo_core import files
from rpo_core.files.validation import choice, printable

Command = TypeVar('Command', bound=Callable[..., None])


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


def list_(
    what: Annotated[str, typer.Argument(help=f'{", ".join(KINDS)}  [all]')] = '',
) -> None:
    """Print the names of what ships: scenarios, plans, controllers, campaigns."""
    console = plain_console()
    for kind in [choice('what', what, KINDS)] if what else KINDS:
        console.print(kind, style='bold')
        for name, document in _documents(KINDS[kind]).items():
            if ('guidance' in document) is (kind == 'plans') or KINDS[kind] != 'scenario':
                console.print(f'  {name:22s}{printable(_said(document))}', soft_wrap=True)


def _documents(kind: str) -> dict[str, dict[str, Any]]:
    shipped = files.shipped(kind).items()
    return {name: files.parse_yaml(files.read_text(path)) for name, path in shipped}


def _said(document: dict[str, Any]) -> str:
    """Return a file in a line: its description, or what a campaign flies."""
    if 'runs' in document:
        return f'{document["runs"]} runs of {document["controller"]} in {document["scenario"]}'
    return document.get('description') or 'no description'


def completing(command: Command) -> Command:
    """Return a command whose parameters complete names of files in a shell, see `NAMED`."""
    hints = get_type_hints(command, include_extras=True)
    for name, kind in NAMED.items():
        for option in getattr(hints.get(name), '__metadata__', ()):
            option.autocompletion = _names_of(kind)
    command.__annotations__ = hints
    return command


def _names_of(kind: str) -> Callable[[str], list[str]]:
    def names(incomplete: str) -> list[str]:
        return [name for name in files.shipped(kind) if name.startswith(incomplete)]

    return names
