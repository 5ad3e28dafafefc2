# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo`; its subcommands are in `rpo.cli.commands`, and import what they need."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option
from typer.core import TyperGroup

from rpo.cli.commands import (
    bench,
    campaign,
    evaluate,
    explain,
    export,
    log,
    plan,
    prove,
    report,
    safety,
    simulate,
    train,
    truth,
)
from rpo.display import plain_console
from rpo_core import files
from rpo_core.files import gone
from rpo_core.files.validation import InputError, choice, printable
from rpo_log.errors import LogError


def _version(wanted: bool) -> None:
    if wanted:
        from rpo_log import provenance

        version, digest = provenance.version('rpo'), provenance.digest()
        typer.echo(f'rpo {version}, sources of core and logs {digest}')
        raise typer.Exit


class _Commands(TyperGroup):
    """Subcommands; a bad input or log of any is one sentence and exit code 2."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for command in (' '.join(args[:1]), ' '.join(args[:2])):
            options = (f'{command} {word.partition("=")[0]}' for word in args if word[:1] == '-')
            for subject, name in (('command', command), *(('option', each) for each in options)):
                if answer := gone.answer(subject, name):
                    typer.echo(f'rpo: `{name}` is {answer}', err=True)
                    raise typer.Exit(2)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except (InputError, LogError) as error:
            typer.echo(f'rpo: {error}', err=True)
            raise typer.Exit(2) from None


app = typer.Typer(
    cls=_Commands,
    help='Train, fly, judge and explain the final-approach controller.',
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode='markdown',  # as markup, `[m]` would be a style, and not be shown
    context_settings={'help_option_names': ['-h', '--help']},
)


_HELP = 'print the version and the digest that `rpo verify` prints, and end'
_Version = Annotated[bool, Option('--version', callback=_version, is_eager=True, help=_HELP)]


@app.callback()
def _options(version: _Version = False) -> None:
    pass


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


for _function in (
    train.train, simulate.simulate, export.scale, evaluate.evaluate, bench.bench,
    plan.optimal, plan.plan, campaign.campaign, truth.truth, prove.prove, evaluate.compare,
    explain.explain, export.export, export.import_, log.verify, log.sign, log.repair,
    list_, report.report,
):  # fmt: skip
    app.command(_function.__name__.rstrip('_'))(_function)
app.add_typer(log.log, name='log')
app.add_typer(safety.safety, name='safety')

_EXAMPLES = files.parse_yaml(Path(__file__).with_name('examples.yaml').read_text('utf-8'))
for _prefix, _typer in (('', app), ('log ', log.log), ('safety ', safety.safety)):
    for _command in _typer.registered_commands:
        if _command.callback is not None:
            name = _command.name or _command.callback.__name__
            _command.epilog = _EXAMPLES[f'{_prefix}{name}']
