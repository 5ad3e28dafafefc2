# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Judgement where a controller was not trained."""

from __future__ import annotations

import re
from dataclasses import replace

from invoking import invoke

from rpo.analysis import judgement
from rpo.analysis.judgement import Demand
from rpo.montecarlo import config as campaigns
from rpo.montecarlo import run_batch
from rpo.montecarlo.statistics import successes
from rpo.training.config import STARTS, load_start

ROBUST = load_start('robust')


def test_everywhere_counts_the_runs_of_the_campaigns(monkeypatch):
    demands = {'random_starts': Demand(450, 1.0), 'paper_test': Demand(40, 0.9, motion=True)}
    monkeypatch.setattr(judgement, 'DEMANDS', demands)
    starts, dispersed, all_limits = judgement.everywhere(ROBUST, 7, 1)
    campaign = campaigns.load('random_starts', runs=450, seed=7)
    campaign = replace(campaign, controller=ROBUST)
    columns = run_batch.fly_runs(campaign, 0, 450)
    assert starts.missed == 450 - int(successes(campaign.config, columns).sum()) > 0
    assert not starts.holds
    assert dispersed.holds and dispersed.success.kept == 40
    assert all_limits.success.kept == 0 and all_limits.least is None, 'slew, in every run'
    result = invoke('evaluate', STARTS['robust'], '--everywhere', '--seed', '7')
    assert re.search(
        rf'random_starts +all limits +{starts.success.kept} / 450 .*MISSED', result.stdout
    )
    shown = ' '.join(result.stdout.split())
    assert 'hold speed per axis (4 of the 6 requirements of paper_test; NOT judged: ' in shown
    assert re.search(r'paper_test +position and speed +40 / 40 .*held', result.stdout)
    assert re.search(r'paper_test +all limits +0 / 40 .*not asked', result.stdout)
    assert 'paper_test, all limits: all 6 requirements of paper_test' in shown
    assert 'its training and paper_test: corner flights' in shown
