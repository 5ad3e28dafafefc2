# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Launch files name only what exists: executables, parameters, arguments, files."""

from __future__ import annotations

import importlib.util
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
import yaml

from rpo_bringup.flight_software_node import OPTIONAL
from rpo_core.files.validation import InputError
from rpo_ros.parameter_rows import tables

SRC = Path(__file__).resolve().parents[2] / 'ros_ws' / 'src'
BRINGUP = SRC / 'rpo_bringup'
FILES = {path.name: ElementTree.parse(path) for path in BRINGUP.glob('launch/*.launch.xml')}
PARAMETER_FILE = BRINGUP / 'config' / 'final_approach.yaml'
FOREIGN = {('rviz2', 'rviz2')}
DEPENDS = {tag.text for tag in ElementTree.parse(BRINGUP / 'package.xml').iter('exec_depend')}
DEPENDS.add('rpo_bringup')


def executables() -> set[tuple[str, str]]:
    """Return (package, executable) of every package's set-up files."""
    return {
        (path.parent.name, name)
        for path in SRC.glob('*/setup.*')
        for name in re.findall(r'(\w+) = [\w.]+:\w+', path.read_text())
    }


def parameters(package: str, executable: str) -> set[str]:
    """Return the names in a node's parameter table."""
    return {row.name for row in tables(package)[executable]}


def declared(tree: ElementTree.ElementTree) -> dict[str, tuple[str | None, str | None]]:
    """Return argument -> (default, description)."""
    return {
        tag.get('name'): (tag.get('default'), tag.get('description')) for tag in tree.findall('arg')
    }


@pytest.fixture(params=sorted(FILES))
def tree(request) -> ElementTree.ElementTree:
    return FILES[request.param]


def test_executables_and_parameters_exist(tree):
    for node in tree.iter('node'):
        who = node.get('pkg'), node.get('exec')
        if who in FOREIGN:
            continue
        assert who in executables(), who
        named = {tag.get('name') for tag in node.findall('param') if tag.get('name')}
        assert named <= parameters(*who), (who, named - parameters(*who))
        assert who[0] in DEPENDS


def test_arguments_and_included_files_are_known(tree):
    arguments = declared(tree)
    assert all(description for _, description in arguments.values())
    text = ElementTree.tostring(tree.getroot(), encoding='unicode')
    known = {*arguments, *(tag.get('name') for tag in tree.iter('let'))}
    assert set(re.findall(r'\$\(var (\w+)\)', text)) <= known
    for argument in tree.findall('arg'):  # as XML and as Python write them
        choices = {tag.get('value') for tag in argument.findall('choice')}
        assert not choices & {'true', 'True'} or choices == {'true', 'false', 'True', 'False'}
    for include in tree.iter('include'):
        name = include.get('file').rsplit('/', 1)[-1]
        given = {tag.get('name') for tag in include.findall('arg')}
        assert (BRINGUP / 'launch' / name).is_file()
        assert not given or given <= set(declared(FILES[name]))
        # Any other form hides the arguments of the included file from `--show-args`.
        assert include.get('file') == f'$(find-pkg-share rpo_bringup)/launch/{name}'


def switched_off(scenario: str, monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Return the launch arguments that needed.launch.py makes false; it runs without `launch`."""
    stubs = {'LaunchContext': None, 'LaunchDescription': list, 'SetLaunchConfiguration': pair}
    stub = SimpleNamespace(**stubs, OpaqueFunction=lambda function: function)
    for name in ('launch', 'launch.actions'):
        monkeypatch.setitem(sys.modules, name, stub)
    described = runpy.run_path(str(BRINGUP / 'launch' / 'needed.launch.py'))
    (function,) = described['generate_launch_description']()
    found = dict(function(SimpleNamespace(launch_configurations={'scenario': scenario})))
    assert set(found.values()) <= {'false'}
    return set(found)


def pair(*words: str) -> tuple[str, ...]:
    """Return the arguments of an action."""
    return words


def test_a_launch_starts_the_nodes_that_its_scenario_needs(monkeypatch):
    chaser, disturbance = {'navigation', 'guidance', 'assurance'}, 'disturbance_injector'
    needs = {
        'quick': {disturbance},
        'approach': set(),
        'assured': {'navigation', 'assurance', disturbance},
        'paper_test_measured': {'navigation', 'assurance', disturbance},
        'docking': {'guidance', 'assurance'},
        'tumbling_docking': {*chaser, 'attitude_controller'},
    }
    for name, needed in needs.items():
        unneeded = {kind.node_name for kind in OPTIONAL} - needed
        assert switched_off(name, monkeypatch) == unneeded, name
    with pytest.raises(InputError, match="got 'nowhere'"):
        switched_off('nowhere', monkeypatch)


def test_each_node_that_a_scenario_may_not_need_can_be_switched_off():
    """By an argument with its name, which needed.launch.py sets before the node is started."""
    whole = FILES['final_approach.launch.xml']
    files = [tag.get('file').rsplit('/', 1)[-1] for tag in whole.iter('include')]
    for kind in OPTIONAL:
        condition = f'$(var {kind.node_name})'
        tags = [
            tag.get('if') or include.get('if')
            for include, name in zip(whole.iter('include'), files, strict=True)
            for tag in (FILES[name].iter('node') if name in FILES else ())
            if tag.get('exec') == kind.node_name
        ]
        assert tags == [condition] and declared(whole)[kind.node_name][0] == 'true'
        first = next(i for i, n in enumerate(files) if n in FILES)
        assert files.index('needed.launch.py') < first


def test_each_run_has_its_own_simulated_time():
    """A node with `use_sim_time` in a namespace listens to the clock of its plant there.

    So does RViz: by the wall clock, tf2 refuses the transforms of a second run, which are older.
    """
    for name, tree in FILES.items():
        if name != 'view.launch.xml':
            groups = [group for group in tree.iter('group') if group.iter('node')]
            pairs = [{(t.get('from'), t.get('to')) for t in g.findall('set_remap')} for g in groups]
            assert all(('/clock', 'clock') in found for found in pairs), name
    (rviz,) = (tag for tag in FILES['view.launch.xml'].iter('node') if tag.get('pkg') == 'rviz2')
    assert [(tag.get('from'), tag.get('to')) for tag in rviz.findall('remap')] == [
        ('/clock', 'clock')
    ]
    (parameter,) = rviz.findall('param')
    assert (parameter.get('name'), parameter.get('value')) == ('use_sim_time', 'true')


def test_an_argument_means_the_same_in_every_file():
    """Included files take the arguments of the file that includes them, by name."""
    said: dict[str, set[str | None]] = {}
    for tree in FILES.values():
        for name, (_, description) in declared(tree).items():
            said.setdefault(name, set()).add(description)
    assert {name: texts for name, texts in said.items() if len(texts) > 1} == {}
    whole = declared(FILES['final_approach.launch.xml'])
    for include in FILES['final_approach.launch.xml'].iter('include'):
        piece = FILES.get(include.get('file').rsplit('/', 1)[-1])
        given = {tag.get('name') for tag in include.findall('arg')}
        if piece not in (None, FILES['view.launch.xml']):  # the views' own arguments stay there
            assert set(declared(piece)) - given <= set(whole)


def test_the_parameter_file_and_the_watch_over_exit_codes_name_what_there_is():
    packages = {name: package for package, name in executables()}
    for block, content in yaml.safe_load(PARAMETER_FILE.read_text()).items():
        name = block.removeprefix('/**/')
        assert set(content['ros__parameters']) <= parameters(packages[name], name)
    text = (BRINGUP / 'launch' / 'exit_code.launch.py').read_text()
    watched = set(re.findall(r"'(\w+)'", re.search(r'FLIGHT_NODES = \((.*?)\)', text, re.S)[1]))
    assert watched <= set(packages)


def test_a_real_launch(ros_env, tmp_path):
    if importlib.util.find_spec('launch_ros') is None:
        pytest.skip('ros2 launch is not installed')

    def launch(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = ['ros2', 'launch', 'rpo_bringup', 'final_approach.launch.xml', *arguments]
        return subprocess.run(
            command, env={**os.environ, **ros_env}, capture_output=True, text=True, timeout=50
        )

    flown = launch('scenario:=quick', f'output:={tmp_path / "run"}', 'namespace:=one')
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert (tmp_path / 'run' / 'run.mcap').stat().st_size > 0
    refused = launch('scenario:=nowhere', 'record:=false')
    assert refused.returncode == 1
    assert "got 'nowhere'" in refused.stdout + refused.stderr
