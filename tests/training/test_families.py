# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Families: export, explanations, and the columns of the comparison."""

from __future__ import annotations

import json
from dataclasses import replace

import fuzzylite as fl
import numpy as np
import pytest
from invoking import invoke
from landing import rest_at_landing

from rpo import exports as export
from rpo.analysis import comparison
from rpo.proof import proven
from rpo.reports.controller import report_of
from rpo_core.chain.flight import fly
from rpo_core.control import controller
from rpo_core.control.baselines import table_inputs
from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_set

NAMES = ('more_words', 'time_to_go')
TRAINING = load_set('paper_training')

# Export and explanation.

STATES = np.random.default_rng(2).uniform(-1, 1, (60, 2)) * np.array([150.0, 2.0])


def test_fuzzylite_reads_a_table_and_agrees():
    law = load_controller('more_words')
    engine = fl.FllImporter().from_string(export.text_of(law, 'fll'))
    for r, v in STATES.tolist():
        distance, speed = table_inputs(r, v)
        engine.input_variable('distance').value = distance
        engine.input_variable('closing_speed').value = speed
        engine.process()
        pull = np.ravel(engine.output_variable('pull').value)[0]
        force = np.clip(-np.sign(r) * pull, -law.max_force_n, law.max_force_n)
        assert law.force_n((r, 0, 0), (v, 0, 0))[0] == pytest.approx(force, abs=1e-12)


def test_fuzzylite_reads_the_rules_of_the_time_to_go_and_agrees():
    law = load_controller('time_to_go')
    engine = fl.FllImporter().from_string(export.text_of(law, 'fll'))
    for tick, (r, v) in zip(range(0, 2400, 40), (0.2 * STATES).tolist(), strict=True):
        values = {'time_to_go': law.time_to_go_s(tick), 'position': r, 'velocity': v}
        for name, value in values.items():
            engine.input_variable(name).value = value
        engine.process()
        force = np.clip(np.ravel(engine.output_variable('force').value)[0], -0.5, 0.5)
        assert law.force_n((r, 0, 0), (v, 0, 0), tick)[0] == pytest.approx(force, abs=1e-12)


@pytest.mark.parametrize(
    ('name', 'word'),
    rest_at_landing([('more_words', 'very near'), ('time_to_go', 'very short')]),
)
def test_rules_and_claims_are_in_json_terminal_and_report(name, word):
    law = load_controller(name)
    claims = [(claim.name, claim.holds) for claim in law.claims()]
    assert all(claim.holds for claim in law.claims() if claim.needed) and len(claims) >= 4

    document = json.loads(export.text_of(law, 'json'))
    assert controller.parse(document['controller']) == law
    assert len(document['rules'][0]['rows']) >= 5
    assert [(claim['name'], claim['holds']) for claim in document['claims']] == claims

    result = invoke('explain', name, '--certify')
    assert result.exit_code == 0, result.output
    assert result.output.count('proven') >= 4 and word in result.output

    sections = {section.title: section for section in report_of(name).sections}
    rules, certificate = (sections[title].blocks[0] for title in ('Rules', 'Certificate'))
    assert list(rules.rows) == law.tables()[0].rows
    assert [(row[0], row[1] == 'proven') for row in certificate.rows] == claims


def test_explain_says_why_at_a_time():
    arguments = ['explain', 'time_to_go', '--state=10,0,0,0,0,0', '--at', '100']
    result = invoke(*arguments)
    assert result.exit_code == 0
    assert 'tick 1000, 100 s since the start' in result.output
    law = load_controller('time_to_go')
    assert f'= {law.force_n((10, 0, 0), (0, 0, 0), 1000)[0]:.3g} N' in result.output


# The comparison's columns.


def test_openings_count_starts_of_thrust_and_changes_of_side():
    steps = np.array([0, 0, 1, 1, 0, 0.003, -1, 1, 1, 0, 1]) * 0.1
    forces = np.column_stack([steps, np.zeros(11), np.full(11, 0.2)])
    assert comparison.openings(forces) == pytest.approx((4 + 0 + 1) / 3)


def test_the_contact_speed_is_that_of_the_first_state_within_a_metre():
    flight = fly(
        replace(TRAINING.base, initial_position_m=(50.0, 5.0, -5.0)), load_controller('mpc')
    )
    ranges = np.linalg.norm(flight.states[:, :3], axis=1)
    first = next(k for k, r in enumerate(ranges) if r < 1.0)
    speed = np.linalg.norm(flight.states[first, 3:])
    assert comparison.contact_speed(flight) == pytest.approx(speed) and 0.01 < speed < 0.3
    still = replace(TRAINING.base, initial_position_m=(9.0, 0.0, 0.0), duration_s=5.0)
    drift = fly(still, load_controller('drift'))
    assert comparison.contact_speed(drift) is None


def test_only_what_is_proven_counts_as_proven():
    found = {
        name: proven.proof_of(load_controller(name)) for name in ('time_to_go', 'more_words', 'mpc')
    }
    assert found == {'time_to_go': 'proven', 'more_words': 'not proven', 'mpc': 'none made'}
