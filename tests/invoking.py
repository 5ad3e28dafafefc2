# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo`, run in the process of a test."""

from __future__ import annotations

from functools import cache

import typer.main
from typer import testing

from rpo.cli.cli import app

# Typer would build the tree of commands anew for each call, which takes 15 ms.
testing._get_command = cache(typer.main.get_command)


def invoke(*words: object) -> testing.Result:
    """Run `rpo` with some words, on a wide screen."""
    return testing.CliRunner().invoke(app, list(map(str, words)), env={'COLUMNS': '300'})


def refused(*words: object) -> str:
    """Return the one sentence by which `rpo` refuses some words; nothing else is printed."""
    done = invoke(*words)
    assert done.exit_code == 2 and not done.stdout, done.output
    assert done.stderr.startswith('rpo: ') and done.stderr.count('\n') == 1, done.stderr
    return done.stderr
