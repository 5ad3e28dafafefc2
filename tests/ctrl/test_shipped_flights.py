# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every shipped controller flies as it did."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flown import lines
from kept import assert_kept

from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_ctrl.family import Mission


def test_shipped_controllers_fly_as_in_the_list():
    assert_kept(Path(__file__).with_name('flights.txt'), lines('ctrl'))


@pytest.mark.parametrize('name', ['more_words', 'pace', 'time_to_go'])
def test_the_values_of_a_family_are_those_of_its_genes(name):
    shipped, mission = load_controller(name), Mission((1.0, 1.0, 1.0), 0.5, 0.1)
    genes = type(shipped).genes()
    for seed in range(20):
        shares = np.random.default_rng(seed).random(len(genes))
        values = [gene.value(x) for gene, x in zip(genes, shares, strict=True)]
        for gene, x, value in zip(genes, shares, values, strict=True):
            assert gene.least <= value <= gene.most
            assert gene.share(value) == pytest.approx(x, abs=2e-2)
            fitted = gene.fitted((2.0, 3.0, 5.0))
            unit = 2.0**gene.metres * 3.0**gene.seconds * 5.0**gene.newtons
            assert fitted.value(x) == pytest.approx(unit * gene.value(x), rel=1e-3, abs=1e-9)
        try:
            made = type(shipped).of_values('drawn', values, mission)
        except InputError:
            continue  # peaks that do not ascend
        again = type(shipped).of_values('drawn', made.values(), mission)
        assert again == made
        for claim in made.claims() if name != 'time_to_go' else ():
            if claim.name == 'only rest at the target' and claim.holds:
                for distance in np.geomspace(0.01, 500.0, 40):
                    assert made.force_n((distance, 0.0, 0.0), (0.0, 0.0, 0.0), 0)[0] < 0.0
