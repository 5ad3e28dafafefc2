# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One rule of exit codes: something judged and missed is 1, with `--no-fail` 0."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from invoking import invoke

from rpo.analysis import attack
from rpo.cli import bench
from rpo.cli.cli import app
from rpo_core.files.validation import InputError

ROOT = Path(__file__).parents[2]
CAMPAIGN = str(ROOT / 'offline_training' / 'rpo' / 'shipped' / 'campaigns' / 'paper_test.yaml')
PAGE = (ROOT / 'docs' / 'exit_codes.md').read_text()
ROWS = re.findall(r'^\| `(.+?)`', PAGE, re.MULTILINE)


def code_of(*words: object) -> int:
    found = invoke(*[str(word) for word in words])
    if isinstance(found.exception, InputError):
        raise found.exception
    return found.exit_code


def codes(*words: object) -> tuple[int, int]:
    """Return the exit codes as it is, and with --no-fail."""
    return code_of(*words), code_of(*words, '--no-fail')


@pytest.mark.parametrize(
    'words',
    [
        'simulate paper_test --controller drift',
        'evaluate drift --scenario paper_test',
        pytest.param('explain allround --certify', marks=pytest.mark.slow),
        pytest.param('report drift', marks=pytest.mark.slow),
    ],
)
def test_what_is_judged_and_missed_is_1(words, tmp_path):
    output = ['--output', tmp_path] if words.startswith('report') else []
    assert codes(*words.split(), *output) == (1, 0)


@pytest.mark.parametrize('words', ['simulate paper_test', 'simulate quick --controller drift'])
def test_nothing_missed_and_nothing_judged_are_0(words):
    assert code_of(*words.split()) == 0


def test_a_campaign_judges_itself_only_where_a_least_share_is_given(tmp_path):
    folder = tmp_path / 'campaign'
    assert code_of('campaign', CAMPAIGN, '--runs', 4, '-o', folder) == 0
    assert codes('campaign', folder, '--least', 100) == (1, 0)
    assert code_of('campaign', folder, '--least', 0) == 0
    assert code_of('campaign', CAMPAIGN, '--run', 1, '--least', 5) == 2


@pytest.mark.parametrize('holds', [True, False])
def test_the_bench_judges_its_whole_table(holds, tmp_path, monkeypatch):
    row = bench.Row('P1', 'inference', 2.0, '1/s', '1/s', 3.0 if holds else 1.0)
    monkeypatch.setattr(bench, 'rows', lambda *_: iter([row]))
    assert codes('bench', '--output', tmp_path) == (int(not holds), 0)


def test_a_broken_limit_of_assurance_is_1(monkeypatch):
    monkeypatch.setattr(attack.Result, 'total', lambda result, column: 1)
    assert codes('safety', 'attack', 'assured', '--runs', 7, '--ticks', 5) == (1, 0)


def commands(group: Any, before: str = 'rpo') -> dict[str, Any]:
    found = {}
    for name, command in group.commands.items():
        if hasattr(command, 'commands'):
            found |= commands(command, f'{before} {name}')
        else:
            found[f'{before} {name}'] = command
    return found


def test_the_page_has_every_command_and_says_which_take_no_fail():
    there = commands(typer.main.get_command(app))
    assert len(there) > 25
    for name, command in there.items():
        rows = [row for row in ROWS if row == name or row.startswith(f'{name} ')]
        takes = any('--no-fail' in option.opts for option in command.params)
        assert bool(rows) == takes, name
        assert rows or f'`{name}`' in PAGE.partition('have no `--no-fail`')[2], name
