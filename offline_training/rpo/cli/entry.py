# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo`, or a sentence where what it needs is not installed."""

from __future__ import annotations

import sys

from rpo.training import processor
from rpo_core.files.output import standard_output
from rpo_core.files.validation import missing_library


@standard_output()
def main() -> None:
    """Entry point of `rpo`."""
    try:
        command = '' if {'-h', '--help'} & {*sys.argv[1:]} else ''.join(sys.argv[1:2])
        if command == processor.SEARCH:
            processor.restart_pinned()
        elif command == 'simulate':
            from rpo_core.kernels import jit

            jit.interpret_first_flight()
        from rpo.cli.cli import app

        app()
    except ModuleNotFoundError as error:
        sentence = missing_library(error.name)
        if sentence is None:
            raise
        print(f'rpo: {sentence}', file=sys.stderr)
        sys.exit(2)
