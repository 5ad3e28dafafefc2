# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What `rpo prove` has shown of shipped controllers: the one source of the tables in the pages.

`rpo prove --check FOLDER --publish` writes `proofs/proven.yaml`. It is about the conditions of the
paper's training, from every start at rest in its box, undisturbed. A result is that of a controller
with the same numbers, whatever its name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from rpo.montecarlo.outputs import digest_of, markdown_table, put, write_text
from rpo.proof.certificate import PROVEN, REFUTED, UNDECIDED, verdict_of
from rpo.proof.problem import Settings
from rpo.scoring.conditions import LABELS, PAPER, label
from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.control.controller import AnyController, FuzzyController, load_fuzzy
from rpo_core.control.family import Family
from rpo_core.files import codec
from rpo_core.files.validation import InputError, schema
from rpo_core.scenario.scenario import load_set

if TYPE_CHECKING:
    from rpo.proof.folder import Folder

PATH = Path(__file__).parents[2] / 'proofs' / 'proven.yaml'
"""The file of the results."""

SCHEMA = 'rpo/proven/1'

NO_PROOF, OPEN = 'none made', 'open'


@dataclass(frozen=True)
class ProvenClaim:
    """A claim as the summary of a proof has it: no start of the box exceeds `bound`.

    found : the greatest value that was flown
    """

    key: str
    statement: str
    unit: str
    limit: float
    bound: float
    found: float

    @property
    def verdict(self) -> str:
        """What the numbers say."""
        verdict = verdict_of(self.limit, self.bound, self.found)
        return OPEN if verdict == UNDECIDED else verdict


@dataclass(frozen=True)
class Proof:
    """The results of one folder.

    numbers_sha256 : digest of what the controller computes with (`numbers_of`)
    command, checked : what made the folder, and what checked it before this was written
    code_sha256 : of the prover
    """

    controller: str
    numbers_sha256: str
    command: str
    checked: str
    code_sha256: str
    claims: tuple[ProvenClaim, ...]


def numbers_of(controller: FuzzyController) -> str:
    """Return a digest of a controller without its name, its description and its provenance."""
    return digest_of(
        controllers.dumps(replace(controller, name='x', description='', provenance={}))
    )


@dataclass(frozen=True)
class Proofs:
    """The file of the results."""

    schema: str
    proofs: tuple[Proof, ...]


def parse(document: Any) -> tuple[Proof, ...]:
    """Return the results of a parsed file; raises InputError."""
    schema(document, SCHEMA)
    return codec.from_mapping(Proofs, '', document).proofs


@lru_cache(maxsize=1)
def shipped() -> tuple[Proof, ...]:
    """Return the results that ship."""
    return files.load(PATH, parse)


def write(proofs: Sequence[Proof]) -> None:
    """Write the file of the results."""
    head = f'# {__name__} reads this; `rpo prove --check FOLDER --publish` writes it.\n'
    document = codec.to_mapping(Proofs(SCHEMA, tuple(proofs)))
    write_text(PATH, head + yaml.safe_dump(document, sort_keys=False, width=100))


def proof_of(controller: AnyController) -> str:
    """Return what is shown of the conditions of the training, in a few words."""
    if isinstance(controller, Family):
        holding = {claim.name for claim in controller.claims() if claim.holds}
        return PROVEN if holding.issuperset(LABELS.values()) else 'not proven'
    digest = numbers_of(controller) if isinstance(controller, FuzzyController) else ''
    claims = [proof.claims for proof in shipped() if proof.numbers_sha256 == digest]
    if not claims:
        return NO_PROOF
    words = {claim.key: claim.verdict for claim in claims[0]}
    for word in (REFUTED, OPEN):
        names = [key for key in PAPER.limits if words.get(key, OPEN) == word]
        if names:
            return f'{word}: {", ".join(map(label, names))}'
    return PROVEN


def markdown(proofs: Sequence[Proof]) -> str:
    """Return a table: a row for each claim, a column for the proof of each controller."""
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for proof in proofs:
        for c in proof.claims:
            verdict = '' if c.verdict == PROVEN else f'**{c.verdict}**: '
            row = cells.setdefault((c.statement, f'{c.limit:g} {c.unit}'), {})
            row[proof.controller] = f'{verdict}{c.bound:.4g} ({c.found:.4g})'
    names = [proof.controller for proof in proofs]
    rows = [(*claim, *(row.get(name, '') for name in names)) for claim, row in cells.items()]
    heads = ('claim', 'limit', *(f'`{proof.command}`' for proof in proofs))
    return '\n'.join(markdown_table(heads, rows)) + '\n'


def of_folder(folder: Folder, options: str) -> Proof:
    """Return what the folder of `rpo prove NAME` shows; raises InputError if it is of another."""
    found, problem = load_set('paper_training'), folder.problem
    name, most = problem.controller.name, found.initial_positions_m.max(axis=0).tolist()
    asked = Settings(centre=(0.0,) * 6, half=(*most, 0.0, 0.0, 0.0))
    same = ('centre', 'half', 'mass_share', 'disturbance_share', 'any_n', 'claims')
    if problem.scenario != found.base or any(
        getattr(problem.settings, field) != getattr(asked, field) for field in same
    ):
        raise InputError(f'{folder.path}: must be that of `rpo prove NAME`, without other options')
    digest = numbers_of(problem.controller)
    if numbers_of(load_fuzzy(name)) != digest:
        raise InputError(f'{folder.path}: has other numbers than the one that ships as {name}')
    fields = ('statement', 'unit', 'limit', 'bound', 'found')
    claims = tuple(
        ProvenClaim(key, *(claim[field] for field in fields))
        for key, claim in folder.summary()['claims'].items()
    )
    checked = f'rpo prove --check {folder.path.name} {options}'
    code = folder.recorded['code_sha256']
    return Proof(name, digest, f'rpo prove {name}', checked, code, claims)


def publish(proof: Proof) -> None:
    """Write a proof in the place of an older one: into the file of results, and the page."""
    made = {found.controller: found for found in shipped()} if PATH.exists() else {}
    proofs = list((made | {proof.controller: proof}).values())
    write(proofs)
    page = PATH.parents[2] / 'docs' / 'proof.md'
    put(page, 'proven', markdown(proofs))
