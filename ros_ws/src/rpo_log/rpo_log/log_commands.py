# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`ros2 run rpo_log verify` and `info`: the commands of `rpo`, where only ROS 2 is."""

from __future__ import annotations

import argparse
import pkgutil
import sys
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Protocol

from rpo_core.files.output import standard_output
from rpo_core.files.validation import InputError, missing_reported, printable
from rpo_log.errors import ExitCode

_COMMANDS = {
    'verify': (
        'rpo_log.verify:verify',
        'Compute a logged flight again, bit for bit; print what is verified, what is not judged.',
    ),
    'info': ('rpo_log.tools.diff:inspect', 'Print what a log holds, and whether it is complete.'),
}
"""Where its function is, which takes the options by their names, and what it does."""
_EPILOG = """example:
  ros2 run rpo_log {} runs/demo

exit code: 0 no problem; 1 not as computed; 2 not a readable log; 3 the log is incomplete;
4 no problem but for what was given
"""

DETAILS = 'print all that was compared, and the SHA-256 of what the verification rests on'
GIVEN = 'topic that a node of somebody else made: it is taken as it is; may be repeated'


class Finding(Protocol):
    """What a command found."""

    @property
    def exit_code(self) -> ExitCode:
        """Exit code of the command."""

    def lines(self) -> Iterable[str]:
        """Return what the command prints."""


def parser(command: str) -> argparse.ArgumentParser:
    """Return the parser of the command line of one command."""
    words = argparse.ArgumentParser(
        prog=f'ros2 run rpo_log {command}',
        description=_COMMANDS[command][1],
        epilog=_EPILOG.format(command),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    words.add_argument('path', type=Path, metavar='run', help='run folder, .mcap file or bag')
    if command == 'verify':
        trusted = 'public key, or folder of them (*.pem): one must have signed the run'
        words.add_argument('--trusted', type=Path, metavar='KEYS', help=trusted)
        words.add_argument('--details', action='store_true', help=DETAILS)
        words.add_argument('--given', action='append', default=[], metavar='TOPIC', help=GIVEN)
        for role in ('scenario', 'controller'):
            words.add_argument(f'--{role}', default='', help=f'{role} of a bag without manifests')
    return words


def show(finding: Finding, details: bool = True) -> int:
    """Print what a command found, or its first line; return its exit code.

    Names in a log may be anything.
    """
    for line in islice(finding.lines(), None if details else 1):
        print(printable(line))
    return int(finding.exit_code)


@standard_output()
def main(command: str) -> int:
    """Entry point of `ros2 run rpo_log` with the name of the command."""
    options = vars(parser(command).parse_args())
    details = options.pop('details', True)
    try:
        with missing_reported():
            return show(pkgutil.resolve_name(_COMMANDS[command][0])(**options), details)
    except InputError as error:
        print(f'{command}: {error}', file=sys.stderr)
        return ExitCode.BAD_INPUT
    except KeyboardInterrupt:
        return 130
