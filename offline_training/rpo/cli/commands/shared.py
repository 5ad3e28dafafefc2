# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What several subcommands share: options, and a clean stop."""

from __future__ import annotations

import math
import shlex
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from rpo.display import Show, progress
from rpo.montecarlo.outputs import make_folder, write_text
from rpo_core.files.validation import InputError, printable

Workers = Annotated[int, Option(min=0, help='threads, 0 = one per core')]
Set = Annotated[
    list[str] | None,
    Option('--set', metavar='KEY=VALUE', help='change a field of the scenario; repeatable'),
]
Cluster = Annotated[
    str, Option(help='local, or a dask scheduler: tcp://127.0.0.1:8786, tls://host:8786')
]
Controller = Annotated[str, Option(help='shipped name or file')]
Output = Annotated[
    Path | None, Option('--output', '-o', help='where to write  [in runs/, by its name]')
]
Resume = Annotated[Path | None, Option(help='folder to go on with')]
NoFail = Annotated[bool, Option('--no-fail', help='exit code 0 although something is missed')]


def echo(text: object, err: bool = False) -> None:
    """Print a line that holds names of files or texts of logs, which may be anything."""
    typer.echo(printable(text), err=err)


def given(context: typer.Context) -> dict[str, str]:
    """Return parameter -> how the command line writes it, for all that this command line gives."""
    options = {str(each.name): max(each.opts, key=len) for each in context.command.params}
    sources = {name: context.get_parameter_source(name) for name in options}
    return {name: options[name] for name, s in sources.items() if s and s.name == 'COMMANDLINE'}


def refuse_beside(context: typer.Context, option: str, *allowed: str) -> None:
    """Raise InputError if more is given beside an option that takes everything from its folder.

    allowed : parameters that the folder does not hold
    """
    others = [text for name, text in given(context).items() if name not in (option, *allowed)]
    if others:
        names = ' and '.join(f'`{text}`' for text in others)
        raise InputError(f'`--{option}` takes everything from its folder: leave out {names}')


def end(missed: bool, no_fail: bool) -> None:
    """End with exit code 1 where something that the command judged is missed.

    One rule for all commands: docs/exit_codes.md.
    """
    if missed and not no_fail:
        raise typer.Exit(1)


def draw(path: Path, made: Callable[..., Any], *subject: Any) -> None:
    """Write the figure that is made of a subject; without matplotlib, say that there is none."""
    from rpo_log.show import style

    try:
        with style.applied():
            make_folder(path.parent)
            style.save_figure(made(*subject), path)
    except ModuleNotFoundError as error:
        typer.echo(f'No picture: {error.name} is not installed.', err=True)
    else:
        echo(path)


def numbers_of(text: str) -> list[float]:
    """Return the numbers of a text like `100,100,100`; none if a part of it is not finite."""
    try:
        values = [float(part) for part in text.split(',')]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []


def write_texts(texts: Mapping[Path, str]) -> None:
    """Write files, and print their names; raises InputError."""
    for path, text in texts.items():
        write_text(path, text)
        echo(path)


@contextmanager
def interruptible(sentence: Callable[[], str]) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM or SIGHUP end the work inside with a sentence and exit code 130."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        echo(sentence(), err=True)
        raise typer.Exit(130) from None


@contextmanager
def saved_work(folder: Path, saved: str, *command: str) -> Iterator[Show]:
    """Show work that is saved in a folder as it comes in, and how long it took.

    saved : what is saved; command : with `--resume FOLDER`, goes on where the work was interrupted
    """
    again = shlex.join([*command, '--resume', str(folder)])
    began, cpu = time.perf_counter(), time.process_time()
    sentence = f'Interrupted; {saved} are saved. Go on with: {again}'
    with interruptible(lambda: sentence), progress(folder) as show:
        yield show
    began, cpu = time.perf_counter() - began, time.process_time() - cpu
    typer.echo(f'took {began:.1f} s; {cpu:.1f} s of CPU time of this process')
