# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation is true: links, commands, names of code and tests, fields of files."""

from __future__ import annotations

import inspect
import json
import os
import pkgutil
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields

import pytest
import typer
import yaml
from doc_blocks import (
    DOCS,
    GENERATED,
    PAGES,
    ROOT,
    Block,
    blocks,
    code,
    files_of,
    folder_like_the_checkout,
    needed_first,
    run_block,
    run_line,
)
from node_pages import NAMES

import rpo
from rpo.cli.cli import app
from rpo_core.control import baselines, controller, controller_file
from rpo_core.control.fuzzy import MembershipFunctions
from rpo_core.files.validation import missing_library
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import DISTURBANCES, Scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world.disturbance import Disturbance, Harmonic

BLOCKS = [block for page in PAGES for block in blocks(page)]
RUN_PAGES = [
    page
    for page in PAGES
    if page.parent == DOCS and any(block.is_run for block in BLOCKS if block.page == page)
]
QUICK = [block for block in BLOCKS if 'quick' in block.orders]


def lines(first: str) -> list[tuple[Block, list[str]]]:
    """Return every command of the documentation that begins with a word, split."""
    found = []
    for block in BLOCKS:
        for line in block.lines:
            words = shlex.split(line, comments=True)
            if words and words[0] == first:
                found.append((block, words))
    return found


def test_links_lead_somewhere():
    for page in [*PAGES, *sorted((ROOT / '.github').glob('*.md'))]:
        for target in re.findall(r'\]\(([^)#:\s]+)(?:#[^)]*)?\)', page.read_text()):
            path = page.parent / target
            there = path.exists() or (path.parent == GENERATED and path.name in NAMES)
            assert there, f'{page.relative_to(ROOT)}: {target}'


def test_rpo_commands_are_understood():
    group = typer.main.get_command(app)
    commands = [(block, words) for block, words in lines('rpo') if '|' not in words]
    assert len(commands) > 20
    for block, words in commands:
        arguments = words[1 : words.index('>')] if '>' in words else words[1:]
        command, context = group, None
        while hasattr(command, 'commands'):
            assert arguments[0] in command.commands, f'{block.place}: {words}'
            command = command.commands[arguments.pop(0)]
        try:
            context = command.make_context('rpo', arguments)
        except typer.Exit:  # --help
            continue
        except Exception as error:
            raise AssertionError(f'{block.place}: {shlex.join(words)}: {error}') from error
        context.close()


def test_ros2_executables_exist():
    commands = [(block, words) for block, words in lines('ros2') if words[1] == 'run']
    assert len(commands) > 10
    for block, words in commands:
        package, executable = words[2:4]
        folder = ROOT / 'ros_ws' / 'src' / package
        setup = ''.join(path.read_text() for path in folder.glob('setup.*'))
        assert re.search(rf'\b{executable} = {package}', setup), f'{block.place}: {words}'


def test_make_targets_exist():
    targets = set(re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    for block, words in lines('make'):
        named = [word for word in words[1:] if '=' not in word]
        assert set(named) <= targets, f'{block.place}: {words}'
    for page in PAGES:
        assert set(re.findall(r'`make ([a-z-]+)', page.read_text())) <= targets, page.name


SNIPPETS = [t for p in PAGES for t in code(p, 'python') if t not in files_of(p).values()]


@pytest.mark.filterwarnings('ignore:this process computes with forms')
@pytest.mark.parametrize('source', SNIPPETS)
def test_python_in_the_pages_runs(source, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    exec(compile(source, 'documentation', 'exec'), {'__name__': 'documentation'})
    assert capsys.readouterr().out or list(tmp_path.iterdir())


def test_the_site_leads_to_every_page():
    nav = (ROOT / 'mkdocs.yml').read_text().partition('\nnav:')[2]
    for page in PAGES[2:]:
        name = page.relative_to(DOCS).as_posix()
        folder = f'{page.parent.name}/'
        assert f' {name}\n' in f'{nav}\n' or f' {folder}\n' in f'{nav}\n', f'{name} is not in nav'


# --- the page of the ROS workspace, and the files that do the same for a machine --------------

WORKFLOWS = sorted((ROOT / '.github/workflows').glob('*.yml'))
JOBS = {
    name: job
    for path in WORKFLOWS
    for name, job in yaml.safe_load(path.read_text())['jobs'].items()
}
DOCKERFILE = (ROOT / 'Dockerfile').read_text().replace('\\\n', ' ')
SCRIPTS = {
    name: [step['run'] for step in job['steps'] if 'run' in step] for name, job in JOBS.items()
}


def understood(script: str) -> bool:
    """Whether bash can read a script; nothing is run."""
    done = subprocess.run(['bash', '-n'], input=script, text=True, capture_output=True)
    return done.returncode == 0 and not done.stderr


def test_machines_build_a_ros_workspace_as_the_page_does(monkeypatch):
    """Docker and GitHub are not here: these files are read, not run."""
    blocks_of_page = [block for block in BLOCKS if block.page.name == 'ros_workspace.md']
    page = {line for block in blocks_of_page for line in block.lines}
    assert all(understood(script) for scripts in SCRIPTS.values() for script in scripts)
    workspace = '\n'.join(SCRIPTS['workspace'])
    steps = [line for line in page if re.match(r'rosdep install|colcon (build|test)$', line)]
    steps += [line for line in page if '--break-system-packages' in line]
    assert len(steps) == 4
    assert all(re.search(f'^{re.escape(line)}', workspace, re.MULTILINE) for line in steps)
    for word in ('rosdep install', 'colcon build', '--break-system-packages'):
        assert word in DOCKERFILE
    monkeypatch.setattr('sys.prefix', sys.base_prefix)  # no virtual environment
    assert any(line in missing_library('mcap.writer') for line in page if 'pip install' in line)
    used = {tuple(shlex.split(line)[2:4]) for line in workspace.splitlines() if 'ros2 run' in line}
    assert used == {('rpo_bringup', 'final_approach'), ('rpo_log', 'verify')}


def test_an_action_is_pinned_by_the_hash_of_its_commit():
    text = ''.join(path.read_text() for path in WORKFLOWS)
    actions = re.findall(r'uses: (.*)', text)
    assert actions
    assert all(re.fullmatch(r'[\w/-]+@[0-9a-f]{40}  # v[\d.]+', action) for action in actions)


def test_the_container_file_can_be_read():
    lines = [line.partition(' ') for line in DOCKERFILE.splitlines()]
    assert all(understood(rest) for word, _, rest in lines if word == 'RUN')
    assert all(json.loads(rest) for word, _, rest in lines if word in ('CMD', 'SHELL'))
    assert all((ROOT / rest.split()[0]).is_dir() for word, _, rest in lines if word == 'COPY')


# --- the page of requirements ----------------------------------------------------------------

REQUIREMENTS = (DOCS / 'requirements.md').read_text()
ROWS = re.findall(r'^- (.+)<br>\n  (.+):\n  (.+)$', REQUIREMENTS, re.MULTILINE)


def exists(dotted: str) -> bool:
    """Whether a dotted name leads to a module, or to something in one."""
    try:
        return pkgutil.resolve_name(dotted) is not None
    except (ImportError, AttributeError):
        return False


def test_every_requirement_names_code_and_tests_that_exist():
    assert len(ROWS) == len(re.findall('^- ', REQUIREMENTS, re.MULTILINE)) > 40
    for statement, where, held in ROWS:
        for name in re.findall(r'`([^`]+)`', where):
            there = (ROOT / name).is_file() if '/' in name else exists(name)
            assert there, f'{statement}: there is no {name}'
        tests = re.findall(r'`(tests/[^`]+)`', held)
        assert tests or 'measured' in held, f'{statement}: nothing holds it'
        for name in tests:
            path, _, function = name.partition('::')
            assert (ROOT / path).is_file(), name
            assert f'def {function}(' in (ROOT / path).read_text(), name


def test_pages_and_notebooks_for_users_use_the_door_alone():
    door = {'gymnasium', 'matplotlib.pyplot', 'numpy', 'rpo', *sys.stdlib_module_names}
    sources = [text for page in ('python', 'gym') for text in code(DOCS / f'{page}.md', 'python')]
    for path in (DOCS / 'notebooks').glob('*.ipynb'):
        cells = json.loads(path.read_text())['cells']
        sources += [''.join(c['source']) for c in cells if c['cell_type'] == 'code']
    imports = re.findall(r'^ *(?:import|from) ([\w.]+)', '\n'.join(sources), re.MULTILINE)
    assert len(imports) > 20 and set(imports) <= door


def of_the_door() -> Iterator[tuple[str, object]]:
    """Yield name and object of what `import rpo` offers, and the methods of its classes."""
    for name in rpo.__all__:
        thing = getattr(rpo, name)
        yield name, thing
        for key, value in inspect.getmembers(thing, callable) if inspect.isclass(thing) else ():
            if key[0] != '_' and str(getattr(value, '__module__', '')).startswith('rpo.door'):
                yield f'{name}.{key}', value


def test_the_api_reference_has_the_whole_door_and_each_section():
    page = re.findall(r'^::: rpo\.(\w+)$', (DOCS / 'api.md').read_text(), re.MULTILINE)
    assert sorted(page) == sorted(rpo.__all__)
    for name, thing in of_the_door():
        text = inspect.getdoc(thing) or ''
        sections = set(re.findall(r'^(\w+)\n-+$', text, re.MULTILINE))
        if not inspect.isclass(thing):
            taken = [key for key in inspect.signature(thing).parameters if key != 'self']
            lines = re.findall(r'^([*\w, ]+?)(?: : .*)?$', text, re.MULTILINE)
            named = {key.lstrip('*') for line in lines for key in line.split(', ')}
            assert set(taken) <= named, f'{name}: {taken}'
            wanted = {'Returns', 'Examples', *(['Parameters'] if taken else [])}
            assert wanted <= sections, f'{name}: {sections}'
        elif issubclass(thing, tuple) or hasattr(thing, '__dataclass_fields__'):
            assert sections & {'Attributes', 'Parameters'}, name


# --- the page of file formats ----------------------------------------------------------------


def test_every_field_of_every_file_is_described():
    text = (DOCS / 'file_formats.md').read_text()
    names = {'schema', 'kind', 'epoch', 'initial_position_axis_m', *DISTURBANCES}
    for section in (Scenario, Disturbance, Harmonic, Thrusters, Navigation, MembershipFunctions):
        names |= {field.name for field in fields(section)} - {'epoch_ns', 'sections'}
    for kind, baseline in controller_file.kinds().items():
        if baseline.__module__.startswith('rpo_core.'):
            names |= {kind, *(field.name for field in fields(baseline))}
    names |= set(baselines.Model.__dataclass_fields__)
    names |= set(controller.to_document(controller.load_controller('allround')))
    missing = sorted(name for name in names if not re.search(rf'\b{name}\b', text))
    assert not missing


# --- running what is printed -----------------------------------------------------------------


@pytest.mark.every_landing
@pytest.mark.parametrize('block', QUICK, ids=lambda block: block.place)
def test_quick_commands(block, ros_env, tmp_path):
    cwd = folder_like_the_checkout(tmp_path / 'page')
    run_block(block, cwd, {**os.environ, **ros_env}, 50.0)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('page', RUN_PAGES, ids=lambda page: page.stem)
def test_a_pages_commands_as_printed(page, ros_env, tmp_path):
    cwd = folder_like_the_checkout(tmp_path / 'page')
    env = {**os.environ, **ros_env}
    del env['RPO_JIT']  # as a user has it
    for command in needed_first(page):
        returned, said = run_line(command, cwd, env, 600.0)
        assert returned == 0, f'{page.name}: `{command}`\n{said}'
    for block in blocks(page):
        if block.is_run:
            run_block(block, cwd, env, 600.0)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_site_builds_without_a_warning_and_needs_no_network(tmp_path):
    done = subprocess.run(['make', 'docs'], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'WARNING' not in done.stdout + done.stderr
    pages = sorted((ROOT / 'site').rglob('*.html'))
    assert len(pages) > 10
    for page in pages:
        text = page.read_text()
        fetched = re.findall(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(https?:[^"]*)"', text)
        assert not [url for url in fetched if 'canonical' not in url], f'{page.name}: {fetched}'
        assert 'class="arithmatex"' not in text, f'{page.name}: an equation was not drawn'
