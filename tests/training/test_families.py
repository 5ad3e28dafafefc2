# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Families: export, explanations, and the columns of the comparison."""

from __future__ import annotations

import json

import fuzzylite as fl
import numpy as np
import pytest
from invoking import invoke
from landing import rest_at_landing

from rpo import exports as export
from rpo.reports.controller import report_of
from rpo_core.control import controller
from rpo_core.control.baselines import table_inputs
from rpo_core.control.controller import load_controller

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


# The comparison's columns.
