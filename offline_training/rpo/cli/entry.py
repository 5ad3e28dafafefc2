# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo`, or a sentence where what it needs is not installed."""

from __future__ import annotations

import sys

from rpo.training import processor
from rpo_core.files.output import standard_output
from rpo_core.files.validation import missing_library

# Module that is missing -> layer of `make setup` that brings it.
_LAYERS = {
    'typer': 'report',
    'rich': 'report',
    'matplotlib': 'report',
    'numba': 'train',
    'pymoo': 'train',
    'cma': 'train',
    'scipy': 'report',
    'cvxpy': 'campaign',
    'distributed': 'campaign',
    'dask': 'campaign',
    'Basilisk': 'truth',
    'cryptography': 'report',
    'rosbags': 'formats',
    'ccsds_ndm': 'formats',
    'fuzzylite': 'test',
    'skfuzzy': 'test',
}

_EXTRAS = ('campaign', 'report', 'train')  # of the wheel, with the names of the layers


@standard_output()
def main() -> None:
    """Entry point of `rpo`."""
    try:
        asked = set(sys.argv[1:])
        if sys.argv[1:2] == [processor.SEARCH] and not asked & {'-h', '--help'}:
            processor.restart_pinned()
        from rpo.cli.cli import app

        app()
    except ModuleNotFoundError as error:
        layer = _LAYERS.get((error.name or '').partition('.')[0])
        sentence = missing_library(error.name)
        if layer is not None:
            extra = f", or `pip install 'rpo[{layer}]'`" if layer in _EXTRAS else ''
            sentence = f'this command needs {error.name}: `make setup LAYERS={layer}`{extra}'
        if sentence is None:
            raise
        print(f'rpo: {sentence}', file=sys.stderr)
        sys.exit(2)
