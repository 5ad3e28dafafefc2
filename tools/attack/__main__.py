# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.attack`: what of changed folders a checker accepts; exit code 1 if a false one.

python -m tools.attack --cases 10000 proofs            what `rpo prove --check` says of proofs
python -m tools.attack runs runs/demo                  what `rpo verify` says of changed runs
python -m tools.attack runs runs/demo --signed         the same, of a run that is signed first
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from tools.attack import proofs, runs
from tools.attack.cases import Making, judge_all


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='attack', description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('--cases', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--first', type=int, default=0, help='number of the first case')
    parser.add_argument('--workers', type=int, default=1, help='processes')
    among = parser.add_subparsers(dest='what', required=True)
    one = among.add_parser('proofs', help='small proofs, which are made first')
    one.add_argument('--kind', choices=proofs.KINDS, action='append', help='may be repeated [both]')
    one = among.add_parser('runs', help='a run')
    one.add_argument('run', type=Path, help='run folder that verifies')
    one.add_argument('--signed', action='store_true', help='sign the run; each case is a lie')
    one.add_argument('--other', type=Path, help='run folder from which lies take files')
    options = parser.parse_args()
    if options.what == 'proofs':
        make: Making = partial(proofs.cases_of, kinds=tuple(options.kind or proofs.KINDS))
    else:
        make = partial(runs.cases_of, run=options.run, signed=options.signed, other=options.other)
    return judge_all(make, options.seed, options.first, options.cases, options.workers)


if __name__ == '__main__':
    sys.exit(main())
