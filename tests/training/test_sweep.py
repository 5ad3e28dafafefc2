# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate --sweep`: one table, one picture, one verdict for all flights."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides
from rpo_core.judge.verdicts import verdicts


def test_each_column_is_a_flight_of_its_own(tmp_path):
    words = ['paper_test', '--set', 'duration_s=230', '--sweep', 'mass_kg=8:30:3', '-o']
    done = CliRunner().invoke(app, ['simulate', *words, str(tmp_path)], env={'COLUMNS': '200'})
    lines = [line.split() for line in done.stdout.splitlines() if line.strip()]
    columns = {line[0]: line for line in lines}
    assert columns['mass_kg'][1:4] == ['8', '19', '30']
    flown = [
        fly(overrides.load('paper_test', ['duration_s=230', f'mass_kg={mass}']),
            load_controller('allround'))
        for mass in (8.0, 19.0, 30.0)
    ]  # fmt: skip
    slews = [next(v for v in verdicts(flight) if 'slew' in v.key).value for flight in flown]
    assert columns['slew'][3:6] == [f'{slew:.3g}' for slew in slews]
    assert columns['all'][1] == 'holds' and columns['all'][3] == 'MISSED' and done.exit_code == 1
    assert (tmp_path / 'sweep.png').stat().st_size > 20_000


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['mass_kg=8'], 'must be KEY=FROM:TO:NUMBER, like mass_kg=8:12:5'),
        (['mass_kg=8:12:1'], 'whole number >= 2'),
        (['mass=8:12:2'], 'did you mean `mass_kg`?'),
        (['mass_kg=8:12:2', '--csv', 'x.csv'], 'no `--csv`'),
    ],
)
def test_a_bad_sweep_is_one_sentence(words, said):
    refused = CliRunner().invoke(app, ['simulate', '--sweep', *words])
    assert refused.exit_code == 2 and said in refused.stderr
