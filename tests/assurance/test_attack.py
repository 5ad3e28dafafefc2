# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attacks on runtime assurance, and how often it acts where it should not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke

from rpo.analysis import assurance as counts
from rpo.analysis import attack
from rpo.analysis.assurance import quiet
from rpo_core.assurance.guard import proof_of
from rpo_core.assurance.settings import Assurance
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario

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


@pytest.mark.parametrize('name', ['allround', pytest.param('paper_ga', marks=pytest.mark.slow)])
@pytest.mark.parametrize('found', ['paper_training', 'paper_test', 'paper_test_phase'])
def test_the_shipped_controllers_need_no_help(name, found):
    """S2: the preset `sqrt` changes none of their commands."""
    counted = quiet(scenario.load(found), load_controller(name), Assurance())
    assert counted.interventions == 0
    assert counted.margin_m_s > 0.0


def test_the_commands_say_what_they_find():
    shown = invoke('safety', 'show', 'assured')
    assert shown.exit_code == 0 and 'authority_m_s2' in shown.output
    attacked = invoke('safety', 'attack', 'assured', '--runs', 7, '--ticks', 50)
    assert attacked.exit_code == 0 and 'all limits held' in attacked.output


# From where an abort is clear, as `rpo safety abort` counts it.


def test_a_band_outside_the_domain_has_no_random_states_and_the_command_says_so():
    changes = ['--set', 'initial_position_m=[0.0,30.0,0.0]', '--set', 'assurance.domain_m=36']
    shown = invoke('safety', 'abort', 'guarded', '--states', 12, *changes)
    assert shown.exit_code == 0 and 'random   20 to 40 m     2 of 2' in shown.stdout
    assert shown.stderr == (
        '0 of 2 random states found from 40 to inf m: '
        '10000 draws in a row were outside the open set\n'
    )


def test_a_scenario_without_a_table_is_refused():
    with pytest.raises(InputError, match=r'around must have `assurance\.abort` and'):
        counts.machine_of(scenario.load_scenario('around'))


@pytest.mark.parametrize(
    ('contact_m_s', 'lateral_m_s', 'hard'),
    [(0.1251, 0.0321, 0), (0.1249, 1.0, 1), (1.0, 0.0319, 1)],
)
def test_a_contact_is_judged_by_the_speeds_at_the_port_itself(contact_m_s, lateral_m_s, hard):
    """Three quarters of the way between two states, so are its speeds: 0.125 m/s, 0.032 across."""
    found = scenario.load_scenario('docking')
    row, g = np.zeros(attack.COLUMNS), proof_of(found.section(Assurance), found).guard
    assert (g.axis, g.side) == (1, 1.0)
    limits = {'contact_m_s': contact_m_s, 'lateral_m_s': lateral_m_s}
    world = attack.world_of(found)._replace(**limits)
    before = (0.0, g.port_m + 0.03, 0.0, 0.005, -0.08, 0.008)
    after = (0.0, g.port_m - 0.01, 0.0, 0.013, -0.14, 0.04)
    attack.touch(before, after, g, world, row)
    assert row[attack.HARD] == hard
