# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The project's virtual environment and the layers of locked packages in it.

The pip of the base interpreter installs uv, and uv the rest, from the same indexes; where there is
none, ensurepip brings one, which takes seconds. `.venv/rpo_setup.json` records what is installed,
after each step. It also marks an installation in progress; an environment with that mark is built
again.
"""

import ast
import hashlib
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence

from host import Interpreter, SetupError, run_python

ROS_LAYER = 'ros'  # replaces an installed ROS 2
BASE_LAYER = 'fly'
INSTALLER = 'installer'  # uv, and the build tools of empy
FROM_ROS = ('numpy',)  # an installed ROS 2 is compiled against its own
_LOCKED = ('--no-deps', '--require-hashes')
_IN_THE_WAY = (  # of installing into .venv
    *('PYTHONPATH', 'PYTHONDONTWRITEBYTECODE'),
    *('PIP_USER', 'PIP_TARGET', 'PIP_PREFIX', 'PIP_ROOT', 'PIP_REQUIRE_VIRTUALENV'),
)
_UV_FOR_PIP = {  # the variable of uv for an option of pip
    'index-url': 'UV_DEFAULT_INDEX',
    'extra-index-url': 'UV_INDEX',
    'find-links': 'UV_FIND_LINKS',
    'trusted-host': 'UV_INSECURE_HOST',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'timeout': 'UV_HTTP_TIMEOUT',
    'proxy': 'ALL_PROXY',
    'cert': 'SSL_CERT_FILE',
    'no-index': 'UV_OFFLINE',
}
_SYSTEM_CERTIFICATES = '/etc/ssl/certs'


class Identity(NamedTuple):
    """The facts that an environment depends on; if one changes, the environment is built again."""

    root: str  #: the checkout (scripts hold absolute paths)
    python: str  #: the base interpreter
    version: str  #: its version, two numbers
    ros_prefix: str  #: the installed ROS 2 that it uses; empty for the wheels


def say(text: str) -> None:
    """Print a step."""
    print(f'[setup] {text}', flush=True)


def digest(*parts: bytes) -> str:
    """Return a hash of `parts` that depends on their borders."""
    return hashlib.sha256(b''.join(b'%d:' % len(part) + part for part in parts)).hexdigest()


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record, in one step on disk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix('.new')
    draft.write_text(json.dumps(record, indent=1) + '\n')
    os.replace(str(draft), str(path))


def uv_environment(pip_config: str, environ: Mapping[str, str]) -> Dict[str, str]:
    """Return the environment in which uv uses the indexes of the configuration of pip.

    pip_config : output of `pip config list`
    environ : its variables of uv override the configuration of pip
    """
    options: Dict[str, str] = {}
    for section in ('global', 'install', ':env:'):  # the last one decides
        for name, value in re.findall(rf'^{section}\.(\S+)=(.*)$', pip_config, re.MULTILINE):
            if name in _UV_FOR_PIP:
                options[_UV_FOR_PIP[name]] = ' '.join(str(ast.literal_eval(value)).split())
    if 'UV_FIND_LINKS' in options:
        options['UV_FIND_LINKS'] = options['UV_FIND_LINKS'].replace(' ', ',')
    # As pip does: use all indexes, and the certificates of the system.
    options['UV_INDEX_STRATEGY'] = 'unsafe-best-match'
    if os.path.isdir(_SYSTEM_CERTIFICATES) and os.listdir(_SYSTEM_CERTIFICATES):
        options['UV_SYSTEM_CERTS'] = 'true'
    return {**options, **environ}


class Environment:
    """The virtual environment `.venv` and its record."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.path = root / '.venv'
        self.python = self.path / 'bin' / 'python'
        self.requirements = root / 'ros_ws' / 'underlay' / 'requirements'
        self._record_file = self.path / 'rpo_setup.json'
        self._log = self.path / 'rpo_install.log'
        self._environ: Dict[str, str] = {}
        self.record = self._read()

    def _read(self) -> Dict[str, Any]:
        try:
            record = json.loads(self._record_file.read_text())
            Identity(**record['identity'])
            return dict(record)
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def write(self, **changes: Any) -> None:
        """Change the record."""
        self.record.update(changes)
        write_record(self._record_file, self.record)

    @property
    def identity(self) -> Optional[Identity]:
        """The facts that a finished environment depends on."""
        return Identity(**self.record['identity']) if self.record else None

    def runs(self) -> bool:
        """Whether the interpreter runs and still has the recorded version."""
        version = 'import sys; print("%d.%d" % sys.version_info[:2])'
        answer = run_python(str(self.python), version, flags=['-S', '-E'])
        return self.identity is not None and (answer or '').strip() == self.identity.version

    def layers_for(self, wanted: Sequence[str]) -> List[str]:
        """Return `wanted` and the layers below it, in the order of installation."""
        base = [BASE_LAYER] if self.identity and self.identity.ros_prefix else [ROS_LAYER, 'fly']
        return base + [layer for layer in wanted if layer not in base]

    def missing(self, wanted: Sequence[str]) -> List[str]:
        """Return the layers whose lock file has changed since their installation."""
        have = self.record.get('layers', {})
        return [x for x in self.layers_for(wanted) if have.get(x) != self._mark(x)]

    def check_layers(self, wanted: Sequence[str]) -> None:
        """Raise SetupError for a layer that has no lock file."""
        known = sorted(p.stem for p in self.requirements.glob('*.txt') if p.stem != 'versions')
        for layer in wanted:
            if layer not in known:
                raise SetupError(f'There is no layer `{layer}`: choose from {", ".join(known)}.')

    def _mark(self, layer: str) -> str:
        """Return the hash of a lock file."""
        return digest((self.requirements / f'{layer}.txt').read_bytes())

    def _requirements(self, layers: Sequence[str]) -> List[str]:
        return [f'--requirement={self.requirements / layer}.txt' for layer in layers]

    def create(self, python: Interpreter, ros_prefix: str, reason: str) -> None:
        """Build an empty environment on `python`; it replaces any other."""
        ground = f'ROS 2 in {ros_prefix}' if ros_prefix else 'ROS 2 wheels'
        say(f'making .venv ({reason}): {python} ({python.path}), {ground}')
        shutil.rmtree(str(self.path), ignore_errors=True)
        version = '%d.%d' % python.version[:2]
        identity = Identity(str(self.root), python.path, version, ros_prefix)
        self.record = {'identity': identity._asdict()}
        more = ['--system-site-packages'] if ros_prefix else []
        make_with([python.path, '-m', 'venv', '--without-pip', str(self.path), *more])
        pip = subprocess.run(self.pip('--version'), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        if pip.returncode != 0:
            make_with([str(self.python), '-m', 'ensurepip'])
        (self.path / 'COLCON_IGNORE').touch()
        (self.path / 'rpo_ros_prefix').write_text(ros_prefix + '\n')
        self.write(layers={}, installing=False)

    def install(self, layers: Sequence[str]) -> None:
        """Install the locked packages of `layers`, checking every hash."""
        say(f'installing {", ".join(layers)}')
        mark, more = self._mark(INSTALLER), []
        if self.record.get(INSTALLER) != mark:
            locked = (*_LOCKED, *self._requirements([INSTALLER]))
            self.run(self.pip('install', '--no-compile', *locked))
            self.write(**{INSTALLER: mark})
        if self.record['identity']['ros_prefix']:
            names = self.path / 'rpo_from_ros.txt'
            names.write_text('\n'.join(FROM_ROS) + '\n')
            more = [f'--excludes={names}']
        self.run(self.uv(*_LOCKED, *more, *self._requirements(layers)))
        self.write(layers={**self.record['layers'], **{x: self._mark(x) for x in layers}})

    def install_editable(self, project: Path) -> None:
        """Install `project` as a link to its source, if its metadata has changed."""
        mark = digest((project / 'pyproject.toml').read_bytes())
        if self.record.get(project.name) == mark:
            return
        say(f'linking {project.name}')
        # A plain path entry: the default import hook would slow down the start of each interpreter.
        plain = ('--config-settings', 'editable_mode=compat')
        self.run(self.uv('--no-deps', '--offline', *plain, '--editable', str(project)))
        self.write(**{project.name: mark})

    def link_packages(self, packages: Sequence[Path]) -> None:
        """Let the interpreter import `packages` without `env.bash`, after what it is given."""
        for folder in self.path.glob('lib/python3.*/site-packages'):
            (folder / 'rpo_packages.pth').write_text(''.join(f'{path}\n' for path in packages))

    def pip(self, *arguments: str) -> List[str]:
        """Return a command of pip."""
        options = ['--no-input', '--disable-pip-version-check', '--no-color']
        python = str(self.python)
        if not any(self.path.glob('lib/python3.*/site-packages/pip')):
            python, options = self.record['identity']['python'], ['--python', python, *options]
        return [python, '-m', 'pip', *options, *arguments]

    def uv(self, *arguments: str) -> List[str]:
        """Return a command of uv that installs."""
        # The lock is complete, so uv resolves nothing; it builds empy with our setuptools.
        command = [str(self.path / 'bin' / 'uv'), 'pip', 'install', '--python', str(self.python)]
        return [*command, '--color', 'never', '--no-build-isolation', *arguments]

    def _environment(self) -> Dict[str, str]:
        """Return the environment variables of an installation; pip is called once."""
        if not self._environ:
            environ = {k: v for k, v in os.environ.items() if k not in _IN_THE_WAY}
            config = subprocess.run(self.pip('config', 'list'), env=environ, stdout=subprocess.PIPE)
            self._environ = uv_environment(config.stdout.decode(), environ)
        return self._environ

    def _contents(self) -> List[int]:
        """Return the times of the last installed or removed package."""
        folders = self.path.glob('lib/python3.*/site-packages')
        return [folder.stat().st_mtime_ns for folder in folders]

    def run(self, command: Sequence[str]) -> None:
        """Run an installation; raise SetupError if it fails."""
        before, output = self._contents(), ''
        self.write(installing=True)
        with subprocess.Popen(
            command,
            env=self._environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            universal_newlines=True,
        ) as process:
            for line in process.stdout or ():
                output += line
                if line.startswith(('Downloading', 'Installed')):  # uv prints the large packages
                    print(f'  {line}', end='', flush=True)
        self._log.write_text(output)
        self.write(installing=process.returncode != 0 and self._contents() != before)
        if process.returncode != 0:
            raise SetupError(failure(output, str(self._log)))


def make_with(command: Sequence[str]) -> None:
    """Run a step of making an environment; raise SetupError if it fails."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if done.returncode != 0:
        raise SetupError(
            f'`{" ".join(command)}` failed ({_last_line(done.stdout.decode())}): repair that '
            'Python or name another one with PYTHON=, then run the same command again.'
        )


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else 'no message'


def failure(output: str, log: str) -> str:
    """Return the error of pip or uv, and what to do, in a sentence."""
    errors = re.findall(r'^(?:ERROR|error|  cause): (.*)', output, re.MULTILINE)
    reason = errors[-1] if errors else _last_line(output)
    return (
        f'The installation failed ({reason}): see {log}, then run the same command again; it '
        'continues where it stopped.'
    )
