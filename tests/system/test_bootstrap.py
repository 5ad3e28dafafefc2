# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The set-up's decisions, put before machines of every kind; what it takes for whole or damaged."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import bootstrap
import host
import layers
import pytest
import workspace
from host import Interpreter, SetupError
from packaging.markers import Marker, default_environment
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
UNDERLAY = ROOT / 'ros_ws' / 'underlay'


def python(version: str, name: str = 'python3', **facts: object) -> Interpreter:
    major, minor, micro = map(int, version.split('.'))
    path = f'/usr/bin/python{major}.{minor}'
    return Interpreter(
        name, path, (major, minor, micro), **{'variant': '', 'has_venv': True, **facts}
    )


def sentence(error: pytest.ExceptionInfo[SetupError]) -> str:
    text = str(error.value)
    assert '\n' not in text
    assert text.endswith('.')
    return text


@pytest.mark.parametrize(
    ('found', 'chosen'),
    [
        ([python('3.9.18'), python('3.14.0'), python('3.13.1'), python('3.12.1')], 2),
        ([python('3.11.2', has_venv=False), python('3.12.1')], 1),
        ([python('3.10.0')], 0),
    ],
)
def test_the_first_interpreter_that_fits_is_taken(found, chosen):
    assert host.choose_interpreter(found) == found[chosen]


@pytest.mark.parametrize(
    ('found', 'asked', 'said'),
    [
        ([python('3.9.18')], None, r'here python3 is 3\.9\.18:'),
        ([python('3.14.0')], None, r'here python3 is 3\.14\.0:'),
        ([python('3.11.9', variant='pypy')], None, r'here python3 is 3\.11\.9 pypy:'),
        ([python('3.13.1', variant='free-threaded')], None, r'is 3\.13\.1 free-threaded:'),
        (
            [python('3.9.2'), python('3.11.2', has_venv=False)],
            None,
            r'apt install python3\.11-venv',
        ),
        ([], None, r'3\.10, 3\.11, 3\.12 or 3\.13 is needed, but here none of python3, '),
        ([], '/no/python', '`/no/python` does not run'),
    ],
)
def test_without_one_a_sentence_says_what_to_do(found, asked, said):
    with pytest.raises(SetupError, match=said) as error:
        host.choose_interpreter(found, asked)
    sentence(error)


def test_a_probe_sees_through_a_virtual_environment():
    found = host.probe(sys.executable)
    assert found.version == sys.version_info[:3] and found.fits
    assert Path(found.path).resolve().is_relative_to(Path(sys.base_prefix).resolve())
    assert host.probe('/no/such/python') is None and host.probe('false') is None


@pytest.mark.parametrize(
    ('facts', 'word'),
    [
        (('Linux', 'x86_64', (2, 28)), ''),
        (('Linux', 'aarch64', (2, 39)), 'aarch64 Linux'),
        (('Darwin', 'x86_64', None), 'Darwin with another C library'),
        (('Linux', 'x86_64', (2, 17)), 'glibc 2.17'),
    ],
)
def test_where_the_wheels_run_and_elsewhere_one_sentence(facts, word):
    problem = host.platform_problem(*facts) or ''
    assert word in problem and bool(word) == bool(problem)
    assert not problem or (problem.endswith('.') and '\n' not in problem)
    assert host.platform_problem(*host.this_platform()) is None


USUAL = '/opt/ros/jazzy/setup.bash'


@pytest.mark.parametrize(
    ('environ', 'files', 'found'),
    [
        ({}, (), None),
        ({}, (USUAL,), '/opt/ros/jazzy'),
        ({'ROS_DISTRO': 'jazzy', 'AMENT_PREFIX_PATH': '/overlay:/mine'},
         ('/mine/share/rclpy/package.xml', '/mine/setup.bash', USUAL), '/mine'),
        # built from source in isolated folders
        ({'ROS_DISTRO': 'jazzy', 'AMENT_PREFIX_PATH': '/ws/install/rclpy'},
         ('/ws/install/rclpy/share/rclpy/package.xml', '/ws/install/setup.bash'), '/ws/install'),
        # our own wheels are no installation
        ({'ROS_DISTRO': 'jazzy', 'AMENT_PREFIX_PATH': '/p/.venv'},
         ('/p/.venv/share/rclpy/package.xml', '/p/.venv/pyvenv.cfg', '/p/.venv/setup.bash'), None),
        ({'RPO_ROS_PREFIX': ''}, (USUAL,), None),
        ({'RPO_ROS_PREFIX': '/x/'}, (USUAL, '/x/setup.bash'), '/x'),
    ],
)  # fmt: skip
def test_which_installation_is_used(environ, files, found):
    """The variable decides; a sourced one goes before that in the usual place."""
    assert host.find_ros(environ, files.__contains__) == found


@pytest.mark.parametrize(
    ('environ', 'said'),
    [
        ({'ROS_DISTRO': 'humble'}, 'ROS 2 humble is sourced'),
        ({'RPO_ROS_PREFIX': '/x'}, r'/x/setup\.bash does not exist'),
    ],
)
def test_another_distribution_or_none_in_its_place_is_refused(environ, said):
    with pytest.raises(SetupError, match=said) as error:
        host.find_ros(environ, {USUAL}.__contains__)
    sentence(error)


def test_an_environment_keeps_the_installation_it_stands_on(tmp_path, monkeypatch):
    monkeypatch.setattr(host, 'find_ros', lambda environ: None)
    monkeypatch.delenv('RPO_ROS_PREFIX', raising=False)
    (tmp_path / 'setup.bash').touch()
    on_it = layers.Identity('/r', '/p', '3.12', str(tmp_path))
    assert bootstrap.ros_for(on_it) == str(tmp_path)
    assert bootstrap.ros_for(on_it._replace(ros_prefix='/gone')) == ''
    monkeypatch.setenv('RPO_ROS_PREFIX', '')
    assert bootstrap.ros_for(on_it) == ''


def test_variables_of_a_sourced_installation_and_of_a_broken_one(tmp_path):
    script, environ = tmp_path / 'setup.bash', {'PATH': '/usr/bin:/bin'}
    script.write_text('export A="b\nc" ROS_DISTRO=jazzy; echo noise\n')
    found = host.ros_environment(str(tmp_path), environ)
    assert (found['A'], found['ROS_DISTRO']) == ('b\nc', 'jazzy')
    script.write_text('echo it is broken >&2; return 3\n')
    with pytest.raises(SetupError, match='it is broken'):
        host.ros_environment(str(tmp_path), environ)
    here = host.probe(sys.executable)._replace(path='/bin/false')
    with pytest.raises(SetupError, match='No Python here imports rclpy') as error:
        host.interpreter_for_ros([here], '/opt/ros/jazzy', {})
    sentence(error)


LOCK = 'rich==15.0.0 \\\n    --hash=sha256:dd\nmcap==1.0 \\\n    --hash=sha256:ee\n'


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the root of a finished environment without packages."""
    root = tmp_path_factory.mktemp('checkout')
    requirements = root / 'ros_ws' / 'underlay' / 'requirements'
    requirements.mkdir(parents=True)
    for name in ('ros', 'fly', 'test', 'versions'):
        (requirements / f'{name}.txt').write_text(LOCK)
    layers.Environment(root).create(host.probe(sys.executable), '', 'a test')
    return root


@pytest.fixture
def venv(made: Path, tmp_path: Path) -> layers.Environment:
    """Return a copy of that environment, to be damaged."""
    shutil.copytree(made, tmp_path, symlinks=True, dirs_exist_ok=True)
    copy = layers.Environment(tmp_path)
    copy.write(identity={**copy.record['identity'], 'root': str(tmp_path)})
    return copy


@pytest.mark.slow
@pytest.mark.parametrize('has_pip', [True, False])
def test_pip_is_that_of_the_interpreter_or_of_ensurepip(has_pip, tmp_path):
    here, name = host.probe(sys.executable), tmp_path / 'python'
    without = '' if has_pip else 'case "$*" in "-m pip "*) exit 1;; esac\n'
    name.write_text(f'#!/bin/sh\n{without}exec {here.path} "$@"\n')
    name.chmod(0o755)
    venv = layers.Environment(tmp_path)
    venv.create(here._replace(path=str(name)), '', 'a test')
    command = venv.pip('--version')
    assert command[0] == str(name if has_pip else venv.python)
    found = subprocess.run(command, capture_output=True, text=True).stdout
    assert ('.venv' in found) is not has_pip, found
    where = 'import sysconfig; print(sysconfig.get_path("purelib"))'
    assert str(tmp_path) in subprocess.check_output([venv.python, '-c', where], text=True)


@pytest.mark.slow
def test_what_is_built_anew_and_why(venv, monkeypatch):
    def reason(asked=None, ros_prefix=''):
        return bootstrap.reason_to_rebuild(layers.Environment(venv.root), asked, ros_prefix)

    monkeypatch.setattr(bootstrap, 'ROOT', venv.root)
    assert reason() is None
    assert reason(asked=sys.executable) is None
    assert 'is made with' in reason(asked='/no/such/python')
    assert 'uses the ROS 2 wheels' in reason(ros_prefix='/opt/ros/jazzy')
    venv.write(installing=True)
    assert 'interrupted' in reason()
    venv.write(installing=False)
    assert reason() is None
    monkeypatch.setattr(bootstrap, 'ROOT', venv.root / 'moved')
    assert f'made in {venv.root}' in reason()
    monkeypatch.setattr(bootstrap, 'ROOT', venv.root)
    venv.python.unlink()
    venv.python.symlink_to('/no/such/python')
    assert 'is missing or has changed' in reason()
    (venv.path / 'rpo_setup.json').write_text('{"identity": {"root"')
    assert 'not complete' in reason()
    shutil.rmtree(venv.path)
    assert 'none yet' in reason()


@pytest.mark.slow
def test_layers_are_known_and_missing_where_their_lock_has_changed(venv):
    venv.check_layers(['test', 'fly'])
    with pytest.raises(SetupError, match='no layer `tset`: choose from fly, ros, test'):
        venv.check_layers(['tset'])
    assert venv.missing(['test']) == ['ros', 'fly', 'test']
    lock = venv.requirements / 'test.txt'
    done = {name: layers.digest(lock.read_bytes()) for name in ('ros', 'fly', 'test')}
    venv.write(layers=done)
    assert venv.missing(['test']) == []
    lock.write_text('changed\n')
    assert venv.missing(['test']) == ['test']
    venv.write(identity={**venv.record['identity'], 'ros_prefix': '/opt/ros/jazzy'})
    assert venv.layers_for(['test']) == ['fly', 'test'], 'an installed ROS 2 needs no wheels'


@pytest.mark.slow
@pytest.mark.parametrize('ros_prefix', ['', '/opt/ros/jazzy'])
def test_every_lock_is_installed_at_once_with_hashes(venv, ros_prefix, monkeypatch):
    commands = []
    monkeypatch.setattr(venv, 'run', commands.append)
    (venv.requirements / 'installer.txt').write_text(LOCK)
    venv.write(identity={**venv.record['identity'], 'ros_prefix': ros_prefix})
    venv.install(['fly', 'test'])
    (_, *pip), (_, *uv) = commands
    for command, names in ((pip, ['installer']), (uv, ['fly', 'test'])):
        locks = [f'--requirement={venv.requirements / name}.txt' for name in names]
        assert [word for word in command if word.startswith('--req')][1:] == locks
        assert {'--require-hashes', '--no-deps'} < set(command)
    without = [word for word in uv if word.startswith('--excludes=')]
    assert len(without) == bool(ros_prefix)  # an installed ROS 2 brings its NumPy
    assert all(Path(word[11:]).read_text() == 'numpy\n' for word in without)
    commands.clear()
    venv.install(['test'])
    assert len(commands) == 1  # uv is there


@pytest.mark.slow
def test_only_an_installation_that_stopped_halfway_leaves_it_damaged(venv):
    folder = next(venv.path.glob('lib/python3.*/site-packages'))
    nothing = venv.pip('install', '--no-index', 'no-such-package==1.0')
    half = ['sh', '-c', f'mkdir {folder}/half && exit 1']
    for command, damaged in ((nothing, False), (half, True)):
        with pytest.raises(SetupError):
            venv.run(command)
        assert layers.Environment(venv.root).record['installing'] is damaged


def test_uv_asks_what_pip_is_configured_to_ask():
    config = (
        "global.index-url='https://one.example/simple'\n"
        "global.extra-index-url='\\nhttps://two.example/simple\\nfile:///three'\n"
        "install.no-index='true'\nglobal.no-index='false'\nfreeze.timeout='10'\n"
        ":env:.find-links='/wheels /more'\nglobal.find-links='/other'\n"
        "global.cert='/ca.pem'\nglobal.quiet='1'\n"
    )
    found = layers.uv_environment(config, {'HOME': '/h', 'SSL_CERT_FILE': '/mine.pem'})
    found.pop('UV_SYSTEM_CERTS', None)
    assert found == {
        'HOME': '/h',
        'SSL_CERT_FILE': '/mine.pem',
        'UV_DEFAULT_INDEX': 'https://one.example/simple',
        'UV_FIND_LINKS': '/wheels,/more',
        'UV_INDEX': 'https://two.example/simple file:///three',
        'UV_INDEX_STRATEGY': 'unsafe-best-match',
        'UV_OFFLINE': 'true',
    }


@pytest.mark.parametrize(
    ('output', 'word'),
    [
        ('WARNING: Retrying ...\nERROR: No matching distribution', '(No matching distribution)'),
        (
            'error: Failed to download `x`\n  cause: Hash mismatch for `x`',
            '(Hash mismatch for `x`)',
        ),
        ('error: Failed to build `x`\n  cause: something new', '(something new)'),
        ('', 'no message'),
    ],
)
def test_every_failure_of_pip_or_uv_is_a_sentence(output, word):
    text = layers.failure(output, '.venv/rpo_install.log')
    assert word in text
    assert text.endswith('.') and '\n' not in text


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a package of a workspace."""
    path = tmp_path / 'src' / 'rpo_x'
    (path / 'rpo_x').mkdir(parents=True)
    for name in (*workspace.METADATA, 'rpo_x/__init__.py'):
        (path / name).write_text('first\n')
    return path


def test_code_is_linked_metadata_is_built(package):
    before = workspace.package_digest(package)
    (package / 'rpo_x' / '__init__.py').write_text('second\n')
    (package / 'rpo_x' / '__pycache__').mkdir()
    (package / 'rpo_x' / '__pycache__' / 'x.pyc').touch()
    (package / 'rpo_x' / '.hidden.swp').touch()
    assert workspace.package_digest(package) == before
    (package / 'config').mkdir()
    (package / 'config' / 'new.yaml').touch()
    with_data = workspace.package_digest(package)
    assert with_data != before
    (package / 'setup.py').write_text('second\n')
    assert workspace.package_digest(package) != with_data


def test_only_what_is_built_and_still_there_is_current(package, tmp_path):
    """After a build that failed, or was interrupted, all is built from nothing."""
    space = workspace.Workspace(tmp_path)
    build, node = tmp_path / 'build', tmp_path / 'install' / 'rpo_x' / 'lib' / 'rpo_x' / 'node'
    answers, tries = iter((True, False, False, True)), []

    def colcon(*_):
        tries.append(build.exists())
        for path in (build / 'any', node):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        return next(answers)

    space._colcon = colcon
    assert space.outdated() == ['rpo_x']
    space.build(Path(sys.executable), {}, ['rpo_x'])
    assert space.outdated() == []
    node.unlink()
    assert space.outdated() == ['rpo_x']
    with pytest.raises(SetupError, match='colcon build of ros_ws failed'):
        space.build(Path(sys.executable), {}, ['rpo_x'])
    assert space.outdated() == ['rpo_x']
    space.build(Path(sys.executable), {}, ['rpo_x'])
    assert space.outdated() == []
    assert tries == [False, True, False, False]


@pytest.mark.parametrize('name', ['bootstrap', 'host', 'layers', 'workspace'])
def test_starts_on_an_old_python_to_refuse_it(name):
    ast.parse((UNDERLAY / f'{name}.py').read_text(), feature_version=(3, 6))


def test_two_at_once_take_turns(tmp_path):
    order = tmp_path / 'order'
    script = (
        f'import sys, time; sys.path.insert(0, {str(UNDERLAY)!r})\n'
        'import bootstrap, pathlib\n'
        f'with bootstrap.only_one(pathlib.Path({str(tmp_path / "lock")!r})):\n'
        f'    with open({str(order)!r}, "a") as f: f.write("in "); f.flush()\n'
        '    time.sleep(0.3)\n'
        f'    with open({str(order)!r}, "a") as f: f.write("out ")\n'
    )
    both = [subprocess.Popen([sys.executable, '-c', script]) for _ in range(2)]
    assert [process.wait(20) for process in both] == [0, 0]
    assert order.read_text() == 'in out in out '


def test_help_has_an_example_and_make_lists_every_target_with_a_line():
    command = [sys.executable, UNDERLAY / 'bootstrap.py', '--help']
    said = subprocess.check_output(command, text=True)
    assert 'example: python3 ros_ws/underlay/bootstrap.py' in said
    lines = subprocess.check_output(['make', 'help'], cwd=ROOT, text=True).splitlines()
    listed = {line.split()[0] for line in lines}
    assert {'setup', 'demo', 'test', 'lint', 'format', 'lock', 'clean', 'help'} <= listed
    assert all(len(line.split()) > 1 for line in lines)


# The lock files: complete, hashed, of one mind, and free of any registry's address.

REQUIREMENTS = UNDERLAY / 'requirements'
LIMITS = {'constraints', 'overrides'}
LAYERS = sorted({path.stem for path in REQUIREMENTS.glob('*.in')} - LIMITS)


def locked(layer: str) -> list[tuple[Requirement, list[str]]]:
    """Return (requirement, hashes) of every entry of a lock file."""
    text = (REQUIREMENTS / f'{layer}.txt').read_text()
    joined = re.sub(r'#.*', '', text).replace('\\\n', ' ')
    entries = []
    for line in filter(None, map(str.strip, joined.splitlines())):
        requirement, *hashes = re.split(r'\s+--hash=', line)
        entries.append((Requirement(requirement), hashes))
    return entries


def versions_for(layer: str, python: str) -> dict[str, str]:
    """Return name -> version that a Python on Linux installs of a layer."""
    environment = {
        **default_environment(),
        'python_version': python,
        'python_full_version': f'{python}.1',
        'sys_platform': 'linux',
    }
    chosen: dict[str, str] = {}
    for requirement, _ in locked(layer):
        marker: Marker | None = requirement.marker
        if marker is None or marker.evaluate(environment):
            assert requirement.name not in chosen, f'{requirement.name} twice for {python}'
            chosen[requirement.name] = str(requirement.specifier)
    return chosen


@pytest.mark.parametrize('layer', LAYERS)
def test_every_entry_is_one_version_with_sha256_hashes_and_no_address(layer):
    for requirement, hashes in locked(layer):
        assert re.fullmatch(r'==[^*,]+', str(requirement.specifier)), requirement
        assert hashes, f'{requirement} has no hash'
        assert all(re.fullmatch('sha256:[0-9a-f]{64}', value) for value in hashes)
    text = (REQUIREMENTS / f'{layer}.txt').read_text()
    assert not re.search(r'://|--(extra-)?index-url|--find-links|^-[if] ', text, re.MULTILINE)


@pytest.mark.parametrize('python', ['3.10', '3.11', '3.12', '3.13'])
def test_layers_have_what_they_name_and_agree_on_versions(python):
    all_versions: dict[str, str] = {}
    for layer in LAYERS:
        versions = versions_for(layer, python)
        for name, version in versions.items():
            assert all_versions.setdefault(name, version) == version, f'{name} in {layer}'
        text = (REQUIREMENTS / f'{layer}.in').read_text()
        lines = filter(None, map(str.strip, re.sub('#.*', '', text).splitlines()))
        assert {Requirement(x).name.lower() for x in lines if x[:2] != '-r'} <= set(versions)
