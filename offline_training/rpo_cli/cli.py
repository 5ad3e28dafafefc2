# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo`; its subcommands are in `rpo_cli.commands`, and import what they need."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rpo_cli.commands import (
    bench,
    campaign,
    compare,
    evaluate,
    explain,
    export,
    listing,
    log,
    optimal,
    plan,
    prove,
    report,
    safety,
    scale,
    simulate,
    train,
    truth,
    watch,
)
from rpo_core.files.validation import InputError
from rpo_mcap.errors import LogError


def _version(wanted: bool) -> None:
    if wanted:
        from rpo_log import provenance

        typer.echo(f'rpo {provenance.version()}, sources of core and logs {provenance.digest()}')
        raise typer.Exit


class _Commands(TyperGroup):
    """Subcommands; a bad input or log of any is one sentence and exit code 2."""

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
    context_settings={'help_option_names': ['-h', '--help']},
)


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            '--version',
            callback=_version,
            is_eager=True,
            help='print the version and the digest that `rpo verify` prints, and end',
        ),
    ] = False,
) -> None:
    pass


app.command(epilog=train.EXAMPLES)(train.train)
app.command(epilog=train.TUNE_EXAMPLES)(train.tune)
app.command(epilog=simulate.EXAMPLES)(simulate.simulate)
app.command(epilog=scale.EXAMPLES)(scale.scale)
app.command(epilog=evaluate.EXAMPLES)(evaluate.evaluate)
app.command(epilog=bench.EXAMPLES)(bench.bench)
app.command(epilog=optimal.EXAMPLES)(optimal.optimal)
app.command(epilog=plan.EXAMPLES)(plan.plan)
app.command(epilog=campaign.EXAMPLES)(campaign.campaign)
app.command(epilog=truth.EXAMPLES)(truth.truth)
app.command(epilog=prove.EXAMPLES)(prove.prove)
app.command(epilog=compare.EXAMPLES)(compare.compare)
app.command(epilog=explain.EXAMPLES)(explain.explain)
app.command(epilog=export.EXAMPLES)(export.export)
app.command('import', epilog=export.IMPORT_EXAMPLES)(export.import_controller)
app.add_typer(log.log, name='log')
app.command(epilog=log.VERIFY_EXAMPLES)(log.verify)
app.command(epilog=log.KEYGEN_EXAMPLES)(log.keygen)
app.command(epilog=log.SIGN_EXAMPLES)(log.sign)
app.command(epilog=log.REPAIR_EXAMPLES)(log.repair)
app.add_typer(safety.safety, name='safety')
app.command('list', epilog=listing.EXAMPLES)(listing.listing)
app.command(epilog=report.EXAMPLES)(report.report)
app.command(epilog=watch.EXAMPLES)(watch.watch)

for _typer in (app, safety.safety):
    for _command in _typer.registered_commands:
        if _command.callback is not None:
            listing.completing(_command.callback)
