# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`final_approach` judges the flight that it recorded: a requirement that is missed is 1."""

from dataclasses import replace

import pytest

from rpo_core.files import scenario
from rpo_core.judge.requirements import Requirements
from tools.node_processes import node_processes


@pytest.mark.parametrize(
    ('options', 'most_n2s', 'code', 'word'),
    [
        ([], 1e-3, 1, 'MISSED'),
        pytest.param(['--no-fail'], 1e-3, 0, 'MISSED', marks=pytest.mark.slow),
        pytest.param([], 1e3, 0, 'holds', marks=pytest.mark.slow),
        pytest.param(['--no-report'], 1e-3, 0, '', marks=pytest.mark.every_landing),
    ],
)
def test_a_requirement_that_is_missed_is_1(options, most_n2s, code, word, ros_env, tmp_path):
    judged = replace(
        scenario.load_scenario('quick'), requirements=Requirements(energy_n2s=most_n2s)
    )
    (tmp_path / 'judged.yaml').write_text(scenario.dumps(judged))
    with node_processes(ros_env, tmp_path) as ros:
        node = ros.node(
            'rpo_bringup', 'final_approach', '--scenario', str(tmp_path / 'judged.yaml'),
            '--output', str(tmp_path / 'run'), *options,
        )  # fmt: skip
        assert node.wait() == code, node.output
    assert word in node.output and ('MISSED' in node.output) == (word == 'MISSED')
