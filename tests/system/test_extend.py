# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""docs/extend.md as printed: its files, flown by the nodes, logged, verified, in a campaign."""

from __future__ import annotations

import os
import re
import shutil

import pytest
from doc_blocks import DOCS, files_of, run_line
from node_processes import node_processes

from rpo_core import files

PAGE = DOCS / 'extend.md'
QUICK = files.find('scenario', 'quick').read_text()


@pytest.fixture
def folder(tmp_path):
    """Write the files of the page."""
    for name, body in files_of(PAGE).items():
        before = QUICK if name == 'lagging.yaml' else ''
        (tmp_path / name).write_text(before + body)
    return tmp_path


@pytest.fixture
def run(folder, ros_env):
    """Run a command with the page's modules."""
    env = {
        **os.environ,
        **ros_env,
        'PYTHONPATH': f'{folder}:{os.environ.get("PYTHONPATH", "")}',
        'RPO_PLUGINS': 'lag,integral',
    }

    def command(line, code=0):
        returned, said = run_line(line, folder, env, 50.0)
        assert returned == code, said
        return said

    return command


FLY = 'ros2 run rpo_bringup final_approach --no-report'


@pytest.mark.every_landing
def test_what_the_page_adds_flies_is_logged_and_verified(run, folder):
    run(f'{FLY} --scenario lagging.yaml --controller mine.yaml --output runs/mine')
    said = run('rpo verify runs/mine')
    assert 'verified, 51 ticks' in said and 'lag' in said and 'controller' in said
    run('rpo log export runs/mine runs/mine.csv')
    head, *rows = (folder / 'runs' / 'mine.csv').read_text().splitlines()
    assert 'lagged_fx_n' in head and len(rows) == 51
    said = run('RPO_PLUGINS= rpo verify runs/mine', code=2)
    assert '`lag` is not a known field' in said or '`kind` must be one of' in said
    scenario = folder / 'lagging.yaml'
    (folder / 'slower.yaml').write_text(scenario.read_text().replace('0.4', '0.39'))
    run(f'{FLY} --scenario slower.yaml --controller mine.yaml --output runs/slower')
    assert 'lagged_force' in run('rpo log diff runs/mine runs/slower', code=1)


@pytest.mark.every_landing
def test_a_campaign_flies_it_and_says_what_is_in_python(run, folder):
    said = run('RPO_JIT=1 rpo campaign campaign.yaml --runs 4 -o runs/campaign')
    assert re.search(r'stage `controller` flies in Python, about [\d.e+]+ times slower', said), said
    folder.joinpath('check.py').write_text(CHECK)
    assert run('RPO_JIT=1 python check.py').strip() == "['', '']"


CHECK = """
from rpo.montecarlo import config, in_python, run_batch
campaign = config.load('campaign.yaml', controller='pd')
flight, columns = run_batch.fly_run(campaign, 3), run_batch.fly_runs(campaign, 0, 4)
assert flight.signals['lagged_force'].any()
assert [columns[name][3] for name in run_batch.FINAL] == flight.states[-1].tolist()
shipped = config.load('paper_test')
print([in_python.sentence(one) for one in (campaign, shipped)])
"""


FROM_ONE_FILE = """
import rpo
from rpo.montecarlo import config, run_batch
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.stage import has_kernel

scenario, controller = rpo.scenario('lagging.yaml'), rpo.controller('pd')
assert all(has_kernel(link.stage) for link in Chain.of(scenario, controller).links)
forces = fly(scenario, controller).signals['lagged_force']
columns = run_batch.fly_runs(config.load('campaign.yaml', controller='pd'), 0, 4)
print(forces.any(), forces.tobytes().hex(), columns['energy_n2s'].tolist())
"""


@pytest.mark.slow
def test_its_kernel_has_the_same_bits_interpreted_and_compiled(folder, run):
    (folder / 'check.py').write_text(FROM_ONE_FILE)
    interpreted, compiled = (run(f'RPO_JIT={jit} python check.py') for jit in (0, 1))
    assert 'True' in compiled and interpreted.splitlines()[-1] == compiled.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which('cc') is None, reason='cc is not installed')
def test_its_kernel_has_the_bits_in_c(run):
    lines = [line for line in PAGE.read_text().splitlines() if 'lagging.c' in line]
    said = run(' && '.join([*lines, './lagging_test lagging_test.txt']))
    assert '50 ticks: every bit is equal' in said
    said = run('rpo export lagging.yaml --to c --controller mine.yaml --output mine.c', code=2)
    assert 'stage `controller` cannot be C: IntegralPdStage has no kernel' in said


def test_a_module_that_is_not_there_is_a_sentence(run):
    said = run('RPO_PLUGINS=nothing rpo simulate quick', code=2)
    assert "`RPO_PLUGINS`: No module named 'nothing'" in said


@pytest.mark.slow
def test_a_controller_with_memory_that_is_started_anew_in_flight_verifies(folder, ros_env, run):
    """It begins without its memory, says so, and the log is verified."""
    env = {**ros_env, 'PYTHONPATH': f'{folder}:{os.environ.get("PYTHONPATH", "")}'}
    env['RPO_PLUGINS'] = 'lag,integral'
    with node_processes(env, folder) as ros:
        mine = {'controller': str(folder / 'mine.yaml')}
        first = ros.node('rpo_ctrl', 'fuzzy_controller', **mine)
        recorder = ros.node('rpo_log', 'recorder', output=str(folder / 'run'))
        plant = ros.node('rpo_sim', 'plant', real_time_factor=40.0, wait_for_recorder='true')
        plant.says('flying')
        first.process.kill()
        second = ros.node('rpo_ctrl', 'fuzzy_controller', **mine)
        assert plant.wait() == 0, plant.output
        assert recorder.wait() == 0, recorder.output
        second.says('the flight is over: waiting for the next')
        assert second.stop() == 0
    assert 'verified, 4001 ticks' in run('rpo verify run')
