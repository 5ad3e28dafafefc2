# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`--help` comes at once: no numerical library, drawing, ROS. Names are listed and completed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from invoking import invoke
from landing import rest_at_landing

from rpo_core import files
from rpo_ros.parameter_rows import ParameterRow, refusal

SRC = Path(__file__).resolve().parents[2] / 'ros_ws' / 'src'
NODES = sorted(
    words
    for path in SRC.glob('*/*/commands.py')
    for words in re.findall(r"start_node, '(\w+)\.(\w+)_node'", path.read_text())
)
COMMANDS = [('rpo_bringup', 'final_approach'), *NODES]
SLOW = {'matplotlib', 'mcap', 'numba', 'numpy', 'rclpy', 'scipy'}

RUN = """
import importlib, sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in ('mcap', 'lz4', 'zstandard'):
            raise ModuleNotFoundError(name + ' is hidden', name=name)
sys.meta_path.insert(0, Hidden())
module, function, *sys.argv = sys.argv[1:]
code = 0
try:
    code = getattr(importlib.import_module(module), function)()
except SystemExit as error:
    code = error.code
if '--help' in sys.argv:
    print(*sys.modules, file=sys.stderr)
sys.exit(code)
"""


def run_main(module: str, function: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run an entry point; without mcap, so nothing flies by mistake."""
    command = [sys.executable, '-c', RUN, module, function, function, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=50)


def help_of(module: str, function: str, *words: str) -> str:
    """Return what `--help` prints; fails if it imported what takes long."""
    done = run_main(module, function, *words, '--help')
    assert done.returncode == 0, done.stderr
    assert not {loaded.partition('.')[0] for loaded in done.stderr.split()} & SLOW
    return done.stdout


@pytest.mark.parametrize(('package', 'name'), rest_at_landing(NODES, quick=4))
def test_a_node_says_its_parameters(package, name):
    text = help_of(f'{package}.commands', name)
    assert text.startswith(f'usage: ros2 run {package} {name} [--ros-args')
    assert f'\nNode `{name}`' in text
    assert f'example:\n  ros2 run {package} {name} --ros-args -p ' in text


def test_final_approach():
    text = help_of('rpo_bringup.commands', 'final_approach')
    assert text.startswith('usage: final_approach')
    assert '--real-time-factor' in text


@pytest.mark.parametrize(('package', 'name'), rest_at_landing(COMMANDS, quick=4))
def test_a_parameter_that_a_node_does_not_have_is_refused(package, name):
    """It flew the default, with a warning."""
    words = ('--ros-args', '-p', 'use_sim_time:=false', '-p', 'dt:=0.5')
    done = run_main(f'{package}.commands', name, *words)
    assert done.returncode == 2 and not done.stdout
    assert re.fullmatch(
        rf'{name} has no parameter `dt`(; did you mean `\w+`.*\? See|; see) '
        rf'`ros2 run {package} {name} --help`\n',
        done.stderr,
    )


def test_what_a_command_line_may_set_and_near_names():
    rows = (ParameterRow('real_time_factor', 0.0, ''), ParameterRow('output', '', ''))
    command = 'ros2 run rpo_sim plant'
    theirs = ('use_sim_time:=true', 'qos_overrides./clock.depth:=1', 'other_node:dt:=1')
    for rule in (*theirs, 'start_type_description_service:=false', 'output:=-p'):
        for option in ('-p', '--param'):
            assert refusal(['plant', '--ros-args', option, rule], rows, command) == ''
    near = refusal(['plant', '--ros-args', '--param', 'real_time_facto:=2'], rows, command)
    assert 'did you mean `real_time_factor`? See' in near


WITHOUT_MCAP = [
    ('rpo_log.commands', 'recorder', ()),
    ('rpo_log.commands', 'verify', ('runs/demo',)),
    ('rpo_bringup.commands', 'final_approach', ('--scenario', 'quick')),
    ('rpo.cli.entry', 'main', ('log', 'info', 'runs/demo')),
]


@pytest.mark.every_landing
@pytest.mark.parametrize(('module', 'function', 'words'), WITHOUT_MCAP)
def test_without_mcap_one_sentence_names_the_command_that_installs_it(module, function, words):
    done = run_main(module, function, *words)
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert re.search(r'is missing: `python3 -m pip install .*mcap` installs it$', done.stderr)


def test_the_version_names_the_code():
    said = invoke('--version').stdout
    assert re.fullmatch(r'rpo \d+\.\d+\.\d+, sources of core and logs [0-9a-f]{64}\n', said)


@pytest.mark.parametrize('words', [(), ('train',)])
def test_rpo(words):
    assert 'Usage' in help_of('rpo.cli.entry', 'main', *words)


def test_the_list_has_every_name_once():
    listed = invoke('list').stdout
    first = [line.split()[0] for line in listed.splitlines() if line.startswith('  ')]
    kinds = ('scenario', 'controller', 'attitude_controller', 'campaign')
    assert sorted(first) == sorted(name for kind in kinds for name in files.shipped(kind))
    plans = invoke('list', 'plans').stdout
    assert '  guarded ' in plans and '  quick ' not in plans


def test_the_command_works_in_a_bare_environment(tmp_path):
    """Without `env.bash`: packages and files come from the checkout."""
    bare = {'HOME': os.environ.get('HOME', '/'), 'PATH': '/usr/bin:/bin', 'RPO_JIT': '0'}
    rpo = Path(sys.prefix) / 'bin' / 'rpo'
    for words in (['list', 'campaigns'], ['simulate', 'quick', '--no-fail']):
        done = subprocess.run(
            [rpo, *words], env=bare, cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0 and 'allround' in done.stdout, done.stderr
