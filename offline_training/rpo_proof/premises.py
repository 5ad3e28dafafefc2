# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a proof is about, in words: controller, scenario, starts, and what may differ."""

from __future__ import annotations

import hashlib
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.files import scenario
from rpo_core.files.scenario import ScenarioSet
from rpo_core.files.validation import quoted
from rpo_proof.claims import Claim
from rpo_proof.folder import Folder
from rpo_proof.problem import Problem


def number(value: float) -> str:
    """Return a number with all of its digits."""
    return repr(value).removesuffix('.0')


def upper(value: float) -> str:
    """Return a number in four digits, rounded up."""
    return _rounded(value, ROUND_CEILING)


def lower(value: float) -> str:
    """Return a number in four digits, rounded down."""
    return _rounded(value, ROUND_FLOOR)


def _rounded(value: float, way: str) -> str:
    return f'{float(Context(prec=4, rounding=way).create_decimal(repr(value))):.4g}'


def row_of(claim: Claim) -> tuple[str, ...]:
    """Return a claim as tables show it: what, limit, proven, flown, open cells, verdict."""
    return (
        claim.statement,
        f'{number(claim.limit)} {claim.unit}',
        upper(claim.bound),
        lower(claim.found) if claim.start else '',
        str(claim.open_cells),
        claim.verdict,
    )


def title_of(problem: Problem) -> str:
    """Return the controller, the scenario, and the box of starts."""
    sides = zip(problem.settings.centre, problem.settings.half, strict=True)
    box = ', '.join(f'{number(centre)} ± {number(half)}' for centre, half in sides)
    return f'{problem.controller.name}, {problem.scenario.name}, from ({box}) m, m/s'


def range_of(problem: Problem) -> str:
    """Return what may differ beside the start, and until when a flight is judged."""
    settings, found = problem.settings, problem.scenario
    mass = f'mass {number(found.mass_kg)} kg'
    if settings.mass_share > 0.0:
        mass += f', and more or less by a share of {number(settings.mass_share)}'
    if settings.disturbance_share > 0.0:
        share = number(settings.disturbance_share)
        known = f'disturbance at any phase, up to {share} times as it is'
    else:
        known = 'no disturbance' if problem.undisturbed else 'disturbance as it is'
    if settings.any_n > 0.0:
        known += f', and any other of {number(settings.any_n)} N per axis at every tick'
    return f'{mass}; {known}; {number(found.duration_s)} s'


def origins(folder: Folder) -> list[str]:
    """Return whether controller and scenario mean those that ship, and digests of their files."""
    names = folder.problem.controller.name, folder.problem.scenario.name
    known = is_shipped_controller(folder.problem), is_shipped_scenario(folder.problem)
    found = []
    kinds = 'controller', 'scenario'
    for kind, content, name, same in zip(kinds, folder.texts[:2], names, known, strict=True):
        digest = hashlib.sha256(content.encode()).hexdigest()
        if same:
            what = f'means the same as the shipped {name}'
        elif name in files.shipped(kind):
            what = f'named {name}, and NOT the one that ships with this name'
        else:
            what = f'{quoted(name)}, which does not ship'
        found.append(f'{kind}: {what}; SHA-256 {digest}')
    return found


def is_shipped_controller(problem: Problem) -> bool:
    """Whether the controller has all numbers that fly of the one that ships with its name."""
    name = problem.controller.name
    return name in files.shipped('controller') and (
        controllers.load_controller(name) == problem.controller
    )


def is_shipped_scenario(problem: Problem) -> bool:
    """Whether the scenario is the one that ships with its name, with the same requirements."""
    ours = problem.scenario
    if ours.name not in files.shipped('scenario'):
        return False
    found = scenario.load(ours.name)
    theirs = found.base if isinstance(found, ScenarioSet) else found
    return theirs == ours and theirs.requirements == ours.requirements
