# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every shipped scenario: flown by its nodes, verified, reported."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core import files
from rpo_core.files import scenario
from rpo_core.files.scenario import ScenarioSet
from rpo_log.tools.diff import diff
from rpo_log.verify import verify
from tools.node_processes import node_processes


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize('name', sorted(files.shipped('scenario')))
def test_a_shipped_scenario_is_flown_verified_and_reported(name, ros_env, tmp_path, monkeypatch):
    found, flown = scenario.load(name), name
    if isinstance(found, ScenarioSet):  # one start of a set is flown at a time
        path = tmp_path / f'{name}.yaml'
        path.write_text(scenario.dumps(found.farthest))
        flown = str(path)
    monkeypatch.delenv('RPO_JIT')
    env = {key: value for key, value in ros_env.items() if key != 'RPO_JIT'}
    folder = tmp_path / 'run'
    options = ('--scenario', flown, '--output', str(folder), '--no-report')
    with node_processes(env, tmp_path) as ros:
        node = ros.node('rpo_bringup', 'final_approach', *options)
        assert node.wait(600.0) == 0, node.output
    verified = verify(folder)
    assert verified.exit_code == 0, verified.sentence()
    alone = ['simulate', flown, '-o', str(tmp_path / 'alone'), '--no-fail']
    assert CliRunner().invoke(app, alone).exit_code == 0
    _, *differ = diff(folder, tmp_path / 'alone').lines()
    assert differ == ['parameters.yaml differs']
    reported = CliRunner().invoke(app, ['report', str(folder)], env={'COLUMNS': '200'})
    assert reported.exit_code == 0, reported.output
    page = (folder / 'report/report.html').read_text(encoding='utf-8')
    assert found.name in page and not re.search(r'>[^<]*\bnan\b', page)
