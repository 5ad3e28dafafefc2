# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attacks on runtime assurance, and how often it acts where it should not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_judge.safety import attack
from rpo_judge.safety.counts import quiet
from rpo_safety.guard import proof_of
from rpo_safety.settings import Assurance

ASSURED = scenario.load_scenario('assured')


@pytest.mark.parametrize('name', ['least_change', 'simplex'])
def test_no_hostile_command_leads_into_the_zone(name):
    """S1 in small: dispersed starts, errors at the edge of the bounds, every kind of command."""
    settings = replace(ASSURED.section(Assurance), filter=name)
    results = attack.attack(ASSURED.equipped(settings), 210, 3, 600)
    for result in results:
        assert result.total(attack.VIOLATED) == 0
        assert result.total(attack.INFEASIBLE) == 0
        assert result.total(attack.TOO_FAST) == 0
        assert result.total(attack.ACTED) > 0
        assert result.least(attack.LEAST_FREE) > 0.0


def test_an_attack_beyond_the_bounds_is_seen(monkeypatch):
    """A disturbance of twice what the proof assumes leads into the zone, and is counted."""

    def wrong(settings, found):
        proof = proof_of(settings, found)
        pushed = proof.errors._replace(disturbance_n=4.0 * proof.errors.disturbance_n)
        return proof._replace(errors=pushed)

    monkeypatch.setattr(attack, 'proof_of', wrong)
    results = attack.attack(ASSURED, 70, 3, 600)
    assert sum(result.total(attack.VIOLATED) for result in results) > 0


def test_the_same_seed_gives_the_same_runs():
    first, again, other = (attack.attack(ASSURED, 14, seed, 200) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        assert (a.rows == b.rows).all()
        assert (a.rows != c.rows).any()


@pytest.mark.parametrize('name', ['trained', pytest.param('robust', marks=pytest.mark.slow)])
@pytest.mark.parametrize('found', ['paper_training', 'paper_test', 'paper_test_phase'])
def test_the_shipped_controllers_need_no_help(name, found):
    """S2: the preset `sqrt` changes none of their commands."""
    counted = quiet(scenario.load(found), load_controller(name), Assurance())
    assert counted.interventions == 0
    assert counted.margin_m_s > 0.01


def run(*words):
    """Return the result of a command line."""
    return CliRunner().invoke(app, ['safety', *words])


def test_the_commands_say_what_they_find():
    shown = run('show', 'assured')
    assert shown.exit_code == 0 and 'authority_m_s2' in shown.output
    attacked = run('attack', 'assured', '--runs', '7', '--ticks', '50')
    assert attacked.exit_code == 0 and 'all limits held' in attacked.output


@pytest.mark.parametrize('words', [('show', 'quick'), ('attack', 'quick')])
def test_a_scenario_without_assurance_is_refused_in_a_sentence(words):
    found = run(*words)
    assert found.exit_code == 2
    assert '`assurance`' in found.output
