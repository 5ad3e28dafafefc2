# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to parameters, and judgement where a controller was not trained."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides
from rpo_core.judge.verdicts import verdicts
from rpo_judge.evaluation import judgement, sensitivity
from rpo_judge.evaluation.judgement import Demand
from rpo_judge.evaluation.sensitivity import Outcome
from rpo_montecarlo.campaign import config as campaigns
from rpo_montecarlo.campaign import run_batch
from rpo_montecarlo.campaign.statistics import successes
from rpo_montecarlo.engine.population import population_of
from rpo_report.controller import draw_effects

ROBUST = load_controller('robust')


def told(controllers, _workers):
    """Return an outcome of each controller that no other has, without a flight."""
    sizes = [population_of(c) for c in controllers]
    sums = [s.scales.sum() + s.functions.sum() + (s.rules * np.arange(25)).sum() for s in sizes]
    return [Outcome(float(x), 0.05, int(x) % 7) for x in sums]


@pytest.fixture(scope='module')
def found():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensitivity, 'outcomes', told)
        return sensitivity.effects(ROBUST, 1)


def test_each_parameter_has_one_effect(found):
    """Two scales, fifteen feet, six groups of rules that oddness and symmetry leave free."""
    _, effects = found
    counts = {part: sum(e.part == part for e in effects) for part in ('position', 'force', 'rules')}
    assert counts == {'position': 6, 'force': 5, 'rules': 6}
    assert len({(e.part, e.parameter) for e in effects}) == len(effects) == 23


def test_an_outcome_is_that_of_the_flights(found, monkeypatch):
    monkeypatch.setattr(sensitivity, 'RUNS', 10)
    wider = replace(ROBUST, velocity_scale_m_s=ROBUST.velocity_scale_m_s * 1.02)
    base, other = sensitivity.outcomes([ROBUST, wider], 1)
    assert base.energy_n2s == pytest.approx(ROBUST.provenance['mean_energy_n2s'], rel=1e-12)
    assert [other] == sensitivity.outcomes([wider], 1) and other != base
    by_name = {(e.part, e.parameter): e for e in found[1]}
    assert [found[0], by_name['velocity', 'scale'].up] == told([ROBUST, wider], 1)
    assert by_name['position', 'small: near foot'].down is None, 'the foot is at zero'


def test_a_table_without_symmetry_has_25_rules():
    codes = ROBUST.system.rules.codes.copy()
    codes[0, 1] = 2
    system = replace(ROBUST.system, rules=type(ROBUST.system.rules).from_codes(codes))
    rows = list(sensitivity._variants(replace(ROBUST, system=system)))
    assert sum(part == 'rules' for part, *_ in rows) == 25


def test_the_picture_has_a_bar_for_each_step(found):
    base, effects = found
    figure = draw_effects(base, effects)
    steps = sum(o is not None for e in effects for o in (e.down, e.up))
    assert len(figure.axes[0].patches) == steps


def test_the_table_names_the_strongest_first(found, monkeypatch):
    monkeypatch.setattr(sensitivity, 'effects', lambda controller, workers: found)
    result = invoke('evaluate', 'robust', '--sensitivity', '--workers', '1')
    assert result.exit_code == 0
    base, effects = found
    places = [result.stdout.index(e.parameter) for e in effects[:2]]
    assert places == sorted(places)
    assert f'now {100 * base.margin:.1f}' in result.stdout


def test_everywhere_counts_the_runs_of_the_campaigns(monkeypatch):
    demands = {'random_starts': Demand(450, 1.0), 'paper_test': Demand(40, 0.9, motion=True)}
    monkeypatch.setattr(judgement, 'DEMANDS', demands)
    starts, dispersed, all_limits = judgement.everywhere(ROBUST, 7, 1)
    campaign = campaigns.load(campaigns.find('random_starts'), runs=450, seed=7)
    campaign = replace(campaign, controller=ROBUST)
    columns = run_batch.fly_runs(campaign, 0, 450)
    assert starts.missed == 450 - int(successes(campaign.config, columns).sum()) > 0
    assert not starts.holds
    assert dispersed.holds and dispersed.success.kept == 40
    assert all_limits.success.kept == 0 and all_limits.least is None, 'slew, in every run'
    result = invoke('evaluate', 'robust', '--everywhere', '--seed', '7')
    assert re.search(
        rf'random_starts +all limits +{starts.success.kept} / 450 .*MISSED', result.stdout
    )
    shown = ' '.join(result.stdout.split())
    assert 'hold speed per axis (4 of the 6 requirements of paper_test; NOT judged: ' in shown
    assert re.search(r'paper_test +position and speed +40 / 40 .*held', result.stdout)
    assert re.search(r'paper_test +all limits +0 / 40 .*not asked', result.stdout)
    assert 'paper_test, all limits: all 6 requirements of paper_test' in shown
    assert 'its training and paper_test: corner flights' in shown


# `rpo simulate --sweep`: one table, one picture, one verdict for all flights.


@pytest.mark.parametrize('masses', [(8.0, 30.0), (30.0, 8.0)])
def test_each_column_is_a_flight_of_its_own(masses, tmp_path):
    """One that misses is exit code 1, also where the last one holds."""
    span = 'mass_kg={:g}:{:g}:2'.format(*masses)
    words = ['paper_test', '--set', 'duration_s=230', '--sweep', span, '-o']
    done = invoke('simulate', *words, tmp_path)
    lines = [line.split() for line in done.stdout.splitlines() if line.strip()]
    columns = {line[0]: line for line in lines}
    assert columns['mass_kg'][1:3] == [f'{mass:g}' for mass in masses]
    flown = [
        fly(overrides.load('paper_test', ['duration_s=230', f'mass_kg={mass}']),
            load_controller('allround'))
        for mass in masses
    ]  # fmt: skip
    slews = [next(v for v in verdicts(flight) if 'slew' in v.key).value for flight in flown]
    assert columns['slew'][3:5] == [f'{slew:.3g}' for slew in slews]
    said = {8.0: 'holds', 30.0: 'MISSED'}
    assert columns['all'][1:3] == [said[mass] for mass in masses] and done.exit_code == 1
    assert (tmp_path / 'sweep.png').stat().st_size > 20_000
