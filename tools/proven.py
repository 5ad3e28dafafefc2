# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Write what proofs have shown of shipped controllers: `offline_training/proofs/proven.yaml`.

Each folder is that of `rpo prove NAME`: every start at rest in the box of the paper's training,
undisturbed. `rpo prove --check` checks it here and now; what fails is not written. The tables of
`docs/proof.md` are written from the same results.

    rpo prove allround && python -m tools.proven runs/proof_allround
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import yaml

from rpo_core.control import controller as controllers
from rpo_core.files.scenario import load_set
from rpo_judge.evaluation import proven
from rpo_judge.evaluation.comparison_table import put_into
from rpo_judge.evaluation.proven import Proof, ProvenClaim
from rpo_montecarlo.outputs import write_text
from rpo_proof.folder import Folder
from rpo_proof.problem import Settings

PAGE = Path(__file__).parents[1] / 'docs' / 'proof.md'

CHECK = ('--cells', '3', '--flights', '1000')


def result_of(path: Path) -> Proof:
    """Return what the folder of a proof shows, after it was checked; SystemExit if it is wrong."""
    folder, found = Folder.open(path), load_set('paper_training')
    problem, starts = folder.problem, found.initial_positions_m
    name = problem.controller.name
    asked = Settings(centre=(0.0,) * 6, half=(*starts.max(axis=0).tolist(), 0.0, 0.0, 0.0))
    if problem.scenario != found.base or not same_starts(problem.settings, asked):
        sys.exit(f'{path}: must be the folder of `rpo prove NAME`, without other options')
    if proven.numbers_of(controllers.load_controller(name)) != proven.numbers_of(
        problem.controller
    ):
        sys.exit(f'{path}: its controller has other numbers than the one that ships as {name}')
    if subprocess.run(
        ['rpo', 'prove', '--check', str(path), '--no-fail', *CHECK], check=False
    ).returncode:
        sys.exit(f'{path}: is not right, and was not written')
    names = ('statement', 'unit', 'limit', 'bound', 'found')
    claims = (
        ProvenClaim(key, *(claim[name] for name in names))
        for key, claim in folder.summary()['claims'].items()
    )
    checked = f'rpo prove --check {path.name} {" ".join(CHECK)}'
    code = folder.recorded['code_sha256']
    digest = proven.numbers_of(problem.controller)
    return Proof(name, digest, f'rpo prove {name}', checked, code, tuple(claims))


def same_starts(mine: Settings, asked: Settings) -> bool:
    """Return whether a proof is about the same starts, and nothing that may differ."""
    names = ('centre', 'half', 'mass_share', 'disturbance_share', 'any_n', 'claims')
    return all(getattr(mine, name) == getattr(asked, name) for name in names)


def main() -> int:
    """Check the folders and write their results, in the place of older ones; return 0."""
    made = {proof.controller: proof for proof in proven.shipped()} if proven.PATH.exists() else {}
    for path in sys.argv[1:]:
        proof = result_of(Path(path))
        made[proof.controller] = proof
    head = f'# {proven.__name__} reads this; `python -m tools.proven FOLDER ...` writes it.\n'
    proofs = [{**asdict(p), 'claims': [asdict(c) for c in p.claims]} for p in made.values()]
    document = {'schema': proven.SCHEMA, 'proofs': proofs}
    write_text(proven.PATH, head + yaml.safe_dump(document, sort_keys=False, width=100))
    put_into(PAGE, proven.markdown(list(made.values())), proven.BEGIN, proven.END)
    return 0


if __name__ == '__main__':
    sys.exit(main())
