# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Compile the kernels ahead of their first use: `python -m rpo.cli.precompile`.

Small commands of each subject compile what it uses, and keep it (`rpo_core.kernels.compile_cache`).
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from io import StringIO
from multiprocessing import get_context
from tempfile import TemporaryDirectory

from rpo.cli.cli import app
from rpo.proof import cells
from rpo.proof.claims import empty_set
from rpo.proof.problem import Problem, Settings
from rpo_core.control.controller import load_fuzzy
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.scenario.scenario import load_set

_COMMANDS = """
simulate quick
simulate world_leo --set duration_s=1.0
simulate tumbling_port
simulate tumbling_docking
simulate guarded
evaluate allround lqr more_words
evaluate allround --scenario least_energy_starts
campaign paper_test --runs 1 --controller lqr --output FOLDER/lqr
campaign paper_test --runs 1 --output FOLDER/paper_test
campaign world_leo --runs 1 --output FOLDER/world_leo
campaign docking --runs 1 --output FOLDER/docking
campaign tumbling_port --runs 1 --output FOLDER/tumbling_port
campaign tumbling_docking --runs 1 --output FOLDER/tumbling_docking
campaign least_energy --runs 1 --output FOLDER/least_energy
safety attack assured --runs 1 --ticks 1
safety quiet quick
"""
_CELL = 'a cell of a proof'


def main() -> None:
    """Run each command, one on each core at a time, and name it."""
    lines = [*_COMMANDS.strip().splitlines(), _CELL]
    cores = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(cores, mp_context=get_context('spawn')) as pool:
        for line in pool.map(_run, lines):
            print(line, flush=True)


def _run(line: str) -> str:
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        if line == _CELL:
            _prove_cell()
        else:
            app(line.replace('FOLDER', folder).split(), standalone_mode=False)
    return line if line == _CELL else f'rpo {line}'


def _prove_cell() -> None:
    base = load_set('paper_training').base
    settings = Settings(centre=(0.0,) * 6, half=(1.0,) * 3 + (0.0,) * 3, coarseness=16.0)
    problem = Problem.of(load_fuzzy(DEFAULT_CONTROLLER), base, settings)
    cell = cells.roots(problem, 'planar')[0]
    cells.Prover(problem, 'planar', empty_set(problem)).values(cell)


if __name__ == '__main__':
    main()
