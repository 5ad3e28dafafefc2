# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A proof of what a controller does from every start of a box, and its check."""

from __future__ import annotations

import html
import secrets
from collections.abc import Collection, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rpo.display import Show, html_rows, progress_in_python
from rpo.door.subjects import file_source, mission_source
from rpo.proof import check as checking
from rpo.proof import proving
from rpo.proof.certificate import PROVEN, REFUTED
from rpo.proof.check import Checked, Sample
from rpo.proof.claims import requirements_of, row_of, worst
from rpo.proof.folder import Folder
from rpo.proof.problem import Problem, Settings
from rpo.proof.proving import Outcome
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario, ScenarioSet, load_scenario

COLUMNS = 'claim', 'limit', 'proven', 'flown', 'open cells'


class Proof:
    """What is proven of a controller, from every start of a box.

    Attributes
    ----------
    folder : Path
        Where the proof is: anyone can check it.
    claims : list of Claim
        Each with `statement`, `limit`, `bound`, which no start exceeds, and `verdict`.
    """

    def __init__(self, folder: Folder, outcome: Outcome, scratch: object = None) -> None:
        self.problem, self.outcome = folder.problem, outcome
        self.folder, self.claims = folder.path, outcome.claims
        self._folder, self._scratch = folder, scratch

    @classmethod
    def open(cls, folder: str | Path) -> Proof:
        """Return the finished proof of a folder, with the claims that follow from its cells.

        Parameters
        ----------
        folder : str or Path
            Of `rpo prove`, or of `rpo.prove`.

        Returns
        -------
        Proof
            Its `check` looks at the cells.

        Raises
        ------
        InputError
            If there is no finished proof, or its summary says something else than its cells.

        Examples
        --------
        >>> import rpo
        >>> rpo.Proof.open('runs/nothing')
        Traceback (most recent call last):
            ...
        rpo_core.files.validation.InputError: runs/nothing...
        """
        opened = Folder.open(Path(folder))
        _, _, follows = checking.followed(opened)
        return cls(opened, Outcome(follows.claims, follows.ranges, {}))

    @property
    def ok(self) -> bool:
        """Whether every claim is proven."""
        return worst(self.claims) == PROVEN

    @property
    def counterexamples(self) -> dict[str, Scenario]:
        """Claim -> the flight that breaks it; empty if no flight breaks any."""
        keys = [claim.key for claim in self.claims if claim.verdict == REFUTED]
        return {key: load_scenario(self._folder.flights(key)[0]) for key in keys}

    def check(self, cells: int = 20, flights: int = 1000, seed: int | None = None) -> Checked:
        """Check the proof independently: in rational numbers, and against flights.

        Parameters
        ----------
        cells : int
            How many of each group are proven again, drawn at random; 0: all.
        flights : int
            How many are compared with the tubes of their cells at every tick.
        seed : int, optional
            Of what is drawn; another each time without.

        Returns
        -------
        Checked
            `ok`, `faults` (a sentence each), and the `claims` that the checker computed itself.

        Raises
        ------
        InputError
            If the folder cannot be read any more.

        Examples
        --------
        >>> import rpo
        >>> proof = rpo.prove('quick', position_m=0.2, coarseness=8.0)
        >>> proof.check(cells=1, flights=1).ok
        True
        """
        with progress_in_python() as show:
            return checked(self._folder, cells, flights, seed, show)

    def __repr__(self) -> str:
        proven = sum(claim.verdict == PROVEN for claim in self.claims)
        said = f'{proven} of {len(self.claims)} claims proven'
        return f'<Proof {self.problem.controller.name}, {self.problem.scenario.name}: {said}>'

    def _repr_html_(self) -> str:
        table = html_rows([(*COLUMNS, 'verdict'), *map(row_of, self.claims)])
        return f'<p>{html.escape(repr(self))}</p><table>{table}</table>'


def prove(
    scenario: str | Path | Scenario | ScenarioSet | Mapping[str, Any] = 'paper_training',
    controller: str | Path | AnyController | Mapping[str, Any] = 'allround',
    *,
    position_m: float | None = None,
    velocity_m_s: float = 0.0,
    mass_share: float = 0.0,
    disturbance_share: float = 0.0,
    any_n: float = 0.0,
    axes_apart: bool = False,
    cell_m: float = 1.0,
    cell_m_s: float = 0.025,
    coarseness: float = 1.0,
    claims: Collection[str] = (),
    folder: str | Path | None = None,
    workers: int = 0,
) -> Proof:
    """Prove what the closed loop does from every start of a box, or find a counterexample.

    Parameters
    ----------
    scenario : str, Path, Scenario, ScenarioSet or mapping
        A set of starts, whose outermost starts are the box; or a flight, the middle of the box.
    controller : str, Path, FuzzyController or mapping
        Name, path or object of a fuzzy controller.
    position_m, velocity_m_s : float
        Half-width of the box on each axis [m, m/s]; the set's own positions without.
    mass_share : float
        Share by which the mass may differ.
    disturbance_share : float
        The scenario's disturbance has any phase, and up to so many times its size; 0: as it is.
    any_n : float
        Any other disturbance, on each axis at each tick [N].
    axes_apart : bool
        Whether each axis is proven alone.
    cell_m, cell_m_s : float
        Half-width of the first cells [m, m/s].
    coarseness : float
        Of the table of the control surface, 1 to 16: a coarse one is made sooner, and proves less.
    claims : collection of str
        Requirements to prove; all without.
    folder : str or Path, optional
        Where the proof is kept, cell by cell; `rpo prove --resume` goes on with it. Without, it
        lasts as long as the object.
    workers : int
        Threads; 0: one per core.

    Returns
    -------
    Proof
        `ok`, `claims`, `counterexamples`; it can be checked.

    Raises
    ------
    InputError
        If scenario or controller is none, or the theory does not know a stage of it.

    Examples
    --------
    >>> import rpo
    >>> proof = rpo.prove('quick', position_m=0.2, coarseness=8.0)
    >>> proof
    <Proof allround, quick: 0 of 1 claims proven>
    >>> list(proof.counterexamples)
    ['hold_error_per_axis_m']
    >>> rpo.prove('quick', 'pd', position_m=0.2)
    Traceback (most recent call last):
        ...
    rpo_core.files.validation.InputError: `controller` must be fuzzy to be proven: ...
    """
    options = {
        'mass_share': mass_share,
        'disturbance_share': disturbance_share,
        'any_n': any_n,
        'axes_apart': axes_apart,
        'cell_m': cell_m,
        'cell_m_s': cell_m_s,
        'coarseness': coarseness,
        'claims': tuple(claims),
    }
    problem = problem_of(scenario, controller, position_m, velocity_m_s, options)
    scratch = TemporaryDirectory(prefix='rpo_proof_') if folder is None else None
    path = Path(scratch.name, 'proof') if scratch else Path(folder or '')
    with progress_in_python() as show:
        return proven(Folder.create(path, problem), workers, show, scratch)


def problem_of(
    scenario: object,
    controller: object,
    position_m: float | None,
    velocity_m_s: float,
    options: Mapping[str, Any],
) -> Problem:
    """Return what is to be proven; see `prove`."""
    mission = mission_source(scenario, {})
    loaded = mission.subject
    half: Any = [position_m] * 3
    if isinstance(loaded, ScenarioSet):
        base, starts = loaded.base, loaded.initial_positions_m
        least, most = starts.min(axis=0), starts.max(axis=0)
        centre = ((least + most) / 2).tolist()
        half = half if position_m is not None else ((most - least) / 2).tolist()
    else:
        base, centre = loaded, loaded.initial_position_m
        if position_m is None:
            raise InputError(
                f'scenario {mission.name} is a single flight: give the half-width of the box of '
                'starts too, `--position 10` or `position_m=10.0`'
            )
    box = (*centre, *base.initial_velocity_m_s), (*half, *3 * [velocity_m_s])
    settings = Settings(centre=box[0], half=box[1], **options)
    problem = Problem.of(file_source(controller).subject, base, settings)
    requirements_of(problem)
    return problem


def proven(folder: Folder, workers: int, show: Show, scratch: object = None) -> Proof:
    """Return the proof of a folder, made from where it was interrupted."""
    return Proof(folder, proving.prove(folder, workers, show), scratch)


def checked(folder: Folder, cells: int, flights: int, seed: int | None, show: Show) -> Checked:
    """Check the proof of a folder; see `Proof.check`."""
    drawn_by = secrets.randbits(32) if seed is None else seed
    return checking.check(folder, Sample(starts=cells, flights=flights, seed=drawn_by), show)
