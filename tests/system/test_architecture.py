# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Who may import whom, what a package declares of it, and the form of every source file."""

from __future__ import annotations

import ast
import re
import sys
from configparser import ConfigParser
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from catkin_pkg.changelog import Changelog, populate_changelog_from_rst

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / 'ros_ws' / 'src'
PACKAGES = {path.parent.name: path.parent for path in sorted(SRC.glob('*/package.xml'))}
OFFLINE = ROOT / 'offline_training'
CITATION = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
CITATION_DATE = str(CITATION['date-released'])
FIRST_PARTY = {*PACKAGES, 'rpo'}
CORE = {'rpo_core'}
FOLDERS = {
    'rpo_core': (
        'files', 'kernels', 'plugins', 'wire', 'stage', 'world', 'scenario', 'attitude', 'control',
        'thrusters', 'navigation', 'guidance', 'assurance', 'chain', 'judge',
    ),
    'rpo': (
        'display', 'engine', 'montecarlo', 'scoring', 'proof', 'analysis', 'training', 'exports',
        'reports', 'door', 'cli',
    ),
}  # fmt: skip
"""Package -> its folders and modules: each imports only those before it."""
ROS_FREE = {'rpo_core', 'rpo_log', 'rpo'}
"""Packages that work without ROS; `rpo_log` has nodes too, which have a row of their own."""

# Which of our packages a package may import.
MAY_IMPORT = {
    'rpo_core': set(),
    'rpo_log': CORE,
    'rpo': CORE | {'rpo_log'},
    'rpo_ros': CORE,
    'rpo_sim': CORE | {'rpo_ros'},
    'rpo_ctrl': CORE | {'rpo_ros'},
    'rpo_log nodes': CORE | {'rpo_ros'},
    'rpo_bringup': CORE | {'rpo_log', 'rpo_ros', 'rpo_sim', 'rpo_ctrl'},
}
CORE_THIRD_PARTY = {'numpy', 'yaml', 'numba', 'llvmlite'}  # numba, with its own, where installed
# As rosdep has them for Ubuntu 24.04, from apt.
ROSDEP_KEYS = {
    'numpy': 'python3-numpy',
    'yaml': 'python3-yaml',
    'cryptography': 'python3-cryptography',
}
# pip brings them: rosdep has no key for mcap, and the other two come with it.
WITHOUT_KEY = {'mcap', 'zstandard', 'lz4'}
# A command that wants one says so, or does without.
OPTIONAL = {'ccsds_ndm', 'llvmlite', 'matplotlib', 'numba', 'rosbags'}


def is_ros(module: str) -> bool:
    """Whether a top-level module comes with ROS 2."""
    return module.startswith(('rcl', 'rosidl', 'rosgraph', 'ament')) or module.endswith(
        ('_msgs', '_srvs', '_interfaces')
    )


@cache
def imported(path: Path) -> frozenset[str]:
    """Return what a file imports, anywhere in it, for types only too, by its full name."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f'{node.module}.{alias.name}' for alias in node.names]
    return frozenset(names)


def imports(path: Path) -> set[str]:
    """Return the top-level modules that a file imports."""
    return {name.partition('.')[0] for name in imported(path)}


@cache
def rooms() -> dict[str, list[Path]]:
    """Return room -> its modules."""
    found = {name: sorted((path / name).rglob('*.py')) for name, path in PACKAGES.items()}
    nodes = [p for p in found['rpo_log'] if p.name.endswith('_node.py')]
    nodes.append(PACKAGES['rpo_log'] / 'rpo_log' / 'commands.py')
    found['rpo_log nodes'] = nodes
    found['rpo_log'] = [path for path in found['rpo_log'] if path not in nodes]
    found['rpo'] = sorted((OFFLINE / 'rpo').rglob('*.py'))
    return found


def sources() -> list[Path]:
    """Return every Python file of ours."""
    found = [ROOT / 'ros_ws' / 'underlay' / 'bin' / 'ros2']
    for folder in ('ros_ws/src', 'ros_ws/underlay', 'offline_training', 'tests', 'docs'):
        found += sorted((ROOT / folder).rglob('*.py'))
    return found


@pytest.mark.parametrize('room', sorted(MAY_IMPORT))
def test_imports_only_what_its_room_may(room):
    own = room.removesuffix(' nodes')
    allowed = MAY_IMPORT[room] | {own}
    for path in rooms()[room]:
        modules = imports(path)
        strangers = (modules & FIRST_PARTY) - allowed
        assert not strangers, f'{path.relative_to(ROOT)} may not import {sorted(strangers)}'
        if room in ROS_FREE:
            ros = sorted(filter(is_ros, modules))
            assert not ros, f'{path.relative_to(ROOT)} must work without ROS, but imports {ros}'


@pytest.mark.parametrize('room', sorted(MAY_IMPORT))
def test_names_in_texts_no_module_that_its_room_may_not_import(room):
    """Such a text is imported when it is needed, and no import shows that."""
    allowed = MAY_IMPORT[room] | {room.removesuffix(' nodes')}
    for path in rooms()[room]:
        for node in ast.walk(ast.parse(path.read_text())):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and re.fullmatch(r'rpo(_\w+)?(\.\w+)+(:\w+)?', text):
                top = text.partition('.')[0]
                assert top in allowed, f'{path.relative_to(ROOT)} may not import {text}'


def test_every_package_has_its_rule():
    assert {room.removesuffix(' nodes') for room in MAY_IMPORT} == FIRST_PARTY


def test_the_core_needs_numpy_and_yaml_alone():
    for path in rooms()['rpo_core']:
        third = imports(path) - set(sys.stdlib_module_names) - CORE
        assert third <= CORE_THIRD_PARTY, f'{path.relative_to(ROOT)} imports {sorted(third)}'


@pytest.mark.parametrize('package', sorted(PACKAGES))
def test_package_declares_what_it_imports(package):
    manifest = ElementTree.parse(PACKAGES[package] / 'package.xml').getroot()
    declared = {tag.text for tag in manifest.iter('exec_depend')}
    needed: set[str] = set()
    for path in (PACKAGES[package] / package).rglob('*.py'):
        for module in imports(path) - {package}:
            if module in FIRST_PARTY or is_ros(module):
                needed.add(module)
            elif module in ROSDEP_KEYS:
                needed.add(ROSDEP_KEYS[module])
            elif module not in sys.stdlib_module_names:
                known = module in WITHOUT_KEY | OPTIONAL
                assert known, f'{path.name} imports {module}: declared how?'
                explained = module in (PACKAGES[package] / 'package.xml').read_text()
                assert explained, f'the package.xml of {package} does not explain {module}'
    assert needed <= declared, f'package.xml lacks {sorted(needed - declared)}'
    keys = {key for key in declared if key.startswith('python3-')}
    assert keys | (declared & FIRST_PARTY) <= needed, 'it declares what it does not import'
    assert keys <= set(ROSDEP_KEYS.values()), 'not a key of rosdep, or not one that is known here'


@pytest.mark.parametrize('package', sorted(PACKAGES))
def test_a_package_has_what_a_release_needs(package):
    folder = PACKAGES[package]
    manifest = ElementTree.parse(folder / 'package.xml').getroot()
    setup = ConfigParser()
    setup.read(folder / 'setup.cfg')
    assert setup['metadata']['name'] == package
    kinds = {tag.get('type') for tag in manifest.findall('url')}
    assert kinds == {'website', 'repository', 'bugtracker'}
    licence = manifest.find('license')
    assert (folder / licence.get('file')).read_bytes() == (ROOT / 'LICENSE').read_bytes()
    assert (folder / 'README.md').read_text().startswith(f'# {package}\n')
    assert (folder / package / '__init__.py').is_file()  # else `colcon build` installs no module
    changes = (folder / 'CHANGELOG.rst').read_text()
    assert f'\nChangelog for package {package}\n' in changes
    found = Changelog(package)
    populate_changelog_from_rst(found, changes)
    assert found.get_content_of_version(CITATION['version'])
    assert str(found.get_date_of_version(CITATION['version']).date()) == CITATION_DATE


def test_version_and_address_are_those_of_the_citation():
    files = [OFFLINE / 'pyproject.toml', *SRC.glob('*/package.xml'), *SRC.glob('*/setup.cfg')]
    text = '\n'.join(path.read_text() for path in files)
    versions = re.findall(
        r'(?:^version = "?|<version>|"rpo_\w+\S*==|rpo_\w+ == )([\d.]+)', text, re.M
    )
    assert len(versions) == 16 and {*versions} == {CITATION['version']}
    address = re.findall(r'(?:Homepage|Repository|Issues) = "?([^"\n]+)|<url [^>]*>([^<]+)', text)
    assert {first or second for first, second in address} == {
        CITATION['repository-code'] + end for end in ('', '.git', '/issues')
    }
    assert {*re.findall(r'email="(.*?)"', text)} == {CITATION['authors'][0]['email']}
    head = f'## [{CITATION["version"]}] - {CITATION_DATE}'
    assert f'\n{head}\n' in (ROOT / 'CHANGELOG.md').read_text()


def test_every_source_file_names_owner_and_licence():
    for path in sources():
        lines = path.read_text().splitlines()
        head = [line for line in lines[:3] if not line.startswith('#!')][:2]
        assert head == [
            '# Copyright 2026 The RPO stack authors',
            '# SPDX-License-Identifier: Apache-2.0',
        ], f'{path.relative_to(ROOT)} lacks its first two lines'


@cache
def graph() -> dict[str, set[str]]:
    """Return each module of ours, and those of ours that it imports; tests left out."""
    paths = {}
    for base in (*PACKAGES.values(), OFFLINE):
        for path in sorted(base.rglob('*.py')):
            parts = path.relative_to(base).with_suffix('').parts
            if parts[0] in FIRST_PARTY:
                paths['.'.join(parts).removesuffix('.__init__')] = path
    edges = {}
    for module, path in paths.items():
        # `from package import name` reads the package's door only where name is no module.
        names = {n if n in paths else n.rpartition('.')[0] for n in imported(path)}
        edges[module] = names & paths.keys() - {module}
    return edges


def test_no_module_imports_itself_through_others():
    """Nor for types only; a package's door may import its own modules, which do not import it."""
    assert 'rpo_core.stage' in graph()['rpo_core.chain.flight'], 'the imports are not found'
    try:
        TopologicalSorter(graph()).prepare()
    except CycleError as error:
        pytest.fail(f'these modules import each other: {" <- ".join(error.args[1])}')


@pytest.mark.parametrize(
    ('package', 'folder'), [(package, name) for package, names in FOLDERS.items() for name in names]
)
def test_a_folder_imports_only_those_before_it(package, folder):
    names = FOLDERS[package]
    allowed = {f'{package}.{name}' for name in names[: names.index(folder) + 1]}
    inside = [n for n in graph() if f'{n}.'.startswith(f'{package}.{folder}.')]
    assert inside
    for name in inside:
        others = {'.'.join(n.split('.')[:2]) for n in graph()[name]}
        above = {n for n in others if n.startswith(f'{package}.')} - allowed
        assert not above, f'{name} may not import {sorted(above)}'


@pytest.mark.parametrize('package', FOLDERS)
def test_every_folder_has_its_place(package):
    places = {n.split('.')[1] for n in graph() if n.startswith(f'{package}.')}
    assert places == set(FOLDERS[package])
