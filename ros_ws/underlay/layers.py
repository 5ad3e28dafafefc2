# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The project's virtual environment and the layers of locked packages in it.

`.venv/rpo_setup.json` says what is in there. It is written after each finished step; while pip
installs it says so, and an environment found in that state is built anew.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence

from host import Interpreter, SetupError, run_python

ROS_LAYER = 'ros'  # stands in for an installed ROS 2
BASE_LAYER = 'fly'
FROM_ROS = ('numpy',)  # an installed ROS 2 is compiled against its own
_PIP_REDIRECTIONS = ('PIP_USER', 'PIP_TARGET', 'PIP_PREFIX', 'PIP_ROOT', 'PIP_REQUIRE_VIRTUALENV')
_NO_NETWORK = re.compile(
    'NewConnectionError|NameResolutionError|Connection refused|ConnectTimeoutError|ProxyError|'
    'Network is unreachable|Temporary failure in name resolution|ReadTimeoutError|SSLError'
)


class Identity(NamedTuple):
    """What an environment is bound to; if any of it changes, the environment is built anew."""

    root: str  #: the checkout (scripts hold absolute paths)
    python: str  #: the base interpreter
    version: str  #: its version, two numbers
    ros_prefix: str  #: the installed ROS 2 it stands on; empty for the wheels


def say(text: str) -> None:
    """Tell the user about a step."""
    print(f'[setup] {text}', flush=True)


def digest(*parts: bytes) -> str:
    """Return a hash of `parts` that keeps their borders."""
    return hashlib.sha256(b''.join(b'%d:' % len(part) + part for part in parts)).hexdigest()


def locked_packages(texts: Iterable[str], left_out: Sequence[str] = ()) -> Dict[str, str]:
    """Return name -> requirement lines, of several lock files that agree on every version."""
    packages: Dict[str, str] = {}
    for text in texts:
        for block in re.split(r'\n(?=[a-zA-Z])', text):
            first = re.match(r'([A-Za-z0-9._-]+)==\S+( ;[^\\\n]*)?', block)
            if first and first.group(1) not in left_out:
                packages[first.group(0)] = block.rstrip()
    return packages


class Environment:
    """The virtual environment `.venv` and its record."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.path = root / '.venv'
        self.python = self.path / 'bin' / 'python'
        self.requirements = root / 'ros_ws' / 'underlay' / 'requirements'
        self._record_file = self.path / 'rpo_setup.json'
        self._log = self.path / 'rpo_pip.log'
        self.record = self._read()

    def _read(self) -> Dict[str, Any]:
        try:
            record = json.loads(self._record_file.read_text())
            Identity(**record['identity'])
            return dict(record)
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def write(self, **changes: Any) -> None:
        """Change the record, in one step on disk."""
        self.record.update(changes)
        draft = self._record_file.with_suffix('.new')
        draft.write_text(json.dumps(self.record, indent=1) + '\n')
        os.replace(str(draft), str(self._record_file))

    @property
    def identity(self) -> Optional[Identity]:
        """What a finished environment is bound to."""
        return Identity(**self.record['identity']) if self.record else None

    def runs(self) -> bool:
        """Whether the interpreter runs and is still of the recorded version."""
        version = 'import sys; print("%d.%d" % sys.version_info[:2])'
        answer = run_python(str(self.python), version, flags=['-S', '-E'])
        return self.identity is not None and (answer or '').strip() == self.identity.version

    def layers_for(self, wanted: Sequence[str]) -> List[str]:
        """Return the layers `wanted` stands on and itself, in the order of installation."""
        base = [BASE_LAYER] if self.identity and self.identity.ros_prefix else [ROS_LAYER, 'fly']
        return base + [layer for layer in wanted if layer not in base]

    def missing(self, wanted: Sequence[str]) -> List[str]:
        """Return the layers whose lock file is not the one that was installed."""
        have = self.record.get('layers', {})
        return [x for x in self.layers_for(wanted) if have.get(x) != digest(self._lock(x))]

    def check_layers(self, wanted: Sequence[str]) -> None:
        """Raise SetupError for a layer that has no lock file."""
        known = sorted(p.stem for p in self.requirements.glob('*.txt') if p.stem != 'versions')
        for layer in wanted:
            if layer not in known:
                raise SetupError(f'There is no layer `{layer}`; there are {", ".join(known)}.')

    def _lock(self, layer: str) -> bytes:
        return (self.requirements / f'{layer}.txt').read_bytes()

    def create(self, python: Interpreter, ros_prefix: str, reason: str) -> None:
        """Build an empty environment on `python`, in place of any other."""
        version = '.'.join(map(str, python.version))
        ground = f'ROS 2 in {ros_prefix}' if ros_prefix else 'ROS 2 wheels'
        say(f'making .venv ({reason}): Python {version} ({python.path}), {ground}')
        shutil.rmtree(str(self.path), ignore_errors=True)
        command = [python.path, '-m', 'venv', str(self.path)]
        command += ['--system-site-packages'] if ros_prefix else []
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if done.returncode != 0:
            raise SetupError(
                f'`{" ".join(command)}` failed ({_last_line(done.stdout.decode())}): repair that '
                'Python or name another one with PYTHON=, then run the same command again.'
            )
        (self.path / 'COLCON_IGNORE').touch()
        (self.path / 'rpo_ros_prefix').write_text(ros_prefix + '\n')
        version = '%d.%d' % python.version[:2]
        self.record = {}
        identity = Identity(str(self.root), python.path, version, ros_prefix)
        self.write(identity=identity._asdict(), layers={}, installing=False)

    def install(self, layers: Sequence[str]) -> None:
        """Install the locked packages of `layers`, checking every hash."""
        assert self.identity is not None
        left_out = FROM_ROS if self.identity.ros_prefix else ()
        packages = locked_packages([self._lock(x).decode() for x in layers], left_out)
        say(f'installing {", ".join(layers)}: {len(packages)} locked packages')
        tools = [name for name in packages if name.startswith(('pip==', 'setuptools=='))]
        self.write(installing=True)
        for names in filter(None, (tools, [name for name in packages if name not in tools])):
            self._pip_locked('\n'.join(packages[name] for name in names) + '\n', len(names))
        have = {**self.record['layers'], **{x: digest(self._lock(x)) for x in layers}}
        self.write(layers=have, installing=False)

    def _pip_locked(self, text: str, total: int) -> None:
        """Install exactly the packages in `text`, a requirements file."""
        chosen = self.path / 'rpo_requirements.txt'
        chosen.write_text(text)
        # The lock is complete, so pip need not resolve; empy's source is built with our setuptools.
        self.pip('--require-hashes', '--no-build-isolation', '-r', str(chosen), total=total)

    def install_editable(self, project: Path) -> None:
        """Install `project` as a link to its source, unless its metadata is as installed."""
        mark = digest((project / 'pyproject.toml').read_bytes())
        if self.record.get(project.name) == mark:
            return
        say(f'linking {project.name}')
        # A plain path entry: the default import hook would slow down every interpreter's start.
        plain = ('--config-settings', 'editable_mode=compat')
        self.pip('--no-build-isolation', '--no-index', *plain, '-e', str(project))
        self.write(**{project.name: mark})

    def pip(self, *arguments: str, total: int = 0) -> None:
        """Run `pip install`, showing how far it is; raise SetupError with what to do."""
        command = [str(self.python), '-m', 'pip', 'install', '--no-deps', '--no-compile']
        command += ['--no-input', '--disable-pip-version-check', '--progress-bar', 'off']
        env = {k: v for k, v in os.environ.items() if k not in _PIP_REDIRECTIONS}
        env.pop('PYTHONPATH', None)
        lines: List[str] = []
        progress = _Progress(total)
        process = subprocess.Popen(
            [*command, *arguments],
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            universal_newlines=True,
        )
        assert process.stdout is not None
        try:
            for line in process.stdout:
                lines.append(line)
                progress.show(line)
        finally:  # an interrupt reaches pip too; it ends by itself
            output = ''.join([*lines, *process.stdout])
            code = process.wait()
            progress.end()
            self._log.write_text(output)
            if code != 0:  # up to that line pip has changed nothing
                self.write(installing='\nInstalling collected packages' in output)
        if code != 0:
            raise SetupError(pip_failure(output, str(self._log)))


class _Progress:
    """One line that counts packages on a terminal; one line in eight packages elsewhere."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._count = 0
        self._terminal = sys.stdout.isatty()

    def show(self, line: str) -> None:
        """Take in one line of pip's output."""
        name = re.match(r'(?:Collecting|Requirement already satisfied:) (\S+?)(?:[=;@ ]|$)', line)
        if name:
            self._count += 1
            text = f'  {self._count}/{self._total} {name.group(1)}'
            if self._terminal:
                print(f'\r\033[K{text}', end='', flush=True)
            elif self._count % 25 == 0:
                print(text, flush=True)
        elif line.startswith('Installing collected packages'):
            self.end()
            if self._total > 10:
                print('  unpacking', flush=True)

    def end(self) -> None:
        """Leave the counting line."""
        if self._terminal and self._count:
            print('\r\033[K', end='', flush=True)
            self._count = 0


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else 'no message'


def pip_failure(output: str, log: str) -> str:
    """Return what went wrong in pip, and what to do, in a sentence."""
    if _NO_NETWORK.search(output):
        return (
            "The package index cannot be reached: check the network (or the proxy, or pip's "
            'configuration), then run the same command again; it goes on where it stopped.'
        )
    if 'DO NOT MATCH THE HASHES' in output:
        return (
            'A downloaded package differs from the one that was locked, and was not installed: '
            f'see {log}; if the index is a mirror, compare it with another.'
        )
    if 'No space left on device' in output:
        return 'The disk is full: free about 1 GB, then run the same command again.'
    errors = [line for line in output.splitlines() if line.startswith('ERROR:')]
    reason = errors[-1][len('ERROR: ') :] if errors else _last_line(output)
    return f'pip failed ({reason}): see {log}, then run the same command again.'
