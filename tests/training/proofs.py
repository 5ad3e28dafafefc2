# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Small proofs for tests: a coarse table, a small box."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from rpo.proof import proving
from rpo.proof.check import Sample
from rpo.proof.folder import Folder
from rpo.proof.problem import Problem, Settings
from rpo.training.config import load_start
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import load, load_set
from rpo_core.world.disturbance import Disturbance, Harmonic

COARSE = 4.0
"""Cells of the table beside the default ones: a sixteenth of the time."""

BOX = (2.0, 1.0, 1.0, 0.0, 0.0, 0.0)

KINDS = ('together', 'apart')
SAMPLE = Sample(starts=0, ticks=0, surface=0)


@cache
def problem_of(name, half=(10.0, 10.0, 10.0, 0.0, 0.0, 0.0)):
    """Return the problem of a shipped controller, from rest in a box about the target."""
    settings = Settings(centre=(0.0,) * 6, half=half, coarseness=COARSE, cell_m_s=0.025)
    return Problem.of(load_start(name), load('paper_training').base, settings)


def problem_of_kind(kind, controller='robust'):
    """Return a small problem: axes together, for ever, one claim refuted; or per axis."""
    base = load_set('paper_training').base
    required = {'mean_error_norm_m': 0.5, 'mean_speed_norm_m_s': 0.05}
    required |= {'hold_error_per_axis_m': 0.5, 'mean_window_s': 10.0}
    if kind == 'together':
        half = 0.6, 0.4, 0.2, 0.001, 0.001, 0.001
        required |= {'slew_per_axis_n_s': 0.04, 'hold_from_s': 40.0}
        base = replace(base, duration_s=50.0)
        settings = Settings(centre=(0.0,) * 6, half=half, coarseness=4.0, cell_m=0.3)
    else:
        known = Disturbance((0.0, 0.002, 0.0), (Harmonic('x', 'sin', 0.004, 0.05),))
        required |= {'hold_from_s': 50.0}
        base = replace(
            base, duration_s=60.0, initial_position_m=(0.5, 0.5, -0.5), disturbance=known
        )
        settings = Settings(
            centre=base.start,
            half=(0.2, 0.2, 0.2, 0.01, 0.01, 0.01),
            coarseness=4.0,
            axes_apart=True,
            disturbance_share=1.0,
            cell_m=0.5,
            cell_m_s=0.02,
        )
    named = replace(base, name=f'small_{kind}', requirements=Requirements(**required))
    return Problem.of(load_start(controller), named, settings)


def proof_of(problem, path):
    """Make a proof in a folder, with few flights beside it."""
    folder = Folder.create(path, problem)
    proving.prove(folder, 1, lambda *_: None, probes=20)
    return Folder.open(path)
