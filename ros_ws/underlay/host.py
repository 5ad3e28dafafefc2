# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The facts about this machine: Python interpreters, ROS 2 installation, platform.

The decisions are pure functions of these facts, so that tests can try any machine. This directory
runs on Python 3.6 or later, so that it can name the version that is needed.
"""

import json
import os
import platform
import subprocess
from typing import Callable, Dict, Mapping, NamedTuple, Optional, Sequence, Tuple

SUPPORTED_VERSIONS = ((3, 10), (3, 11), (3, 12), (3, 13))
CANDIDATES = ('python3', 'python3.12', 'python3.13', 'python3.11', 'python3.10')
ROS_DISTRO = 'jazzy'
DEFAULT_ROS_PREFIX = '/opt/ros/jazzy'
ROS_PREFIX_VARIABLE = 'RPO_ROS_PREFIX'
MINIMUM_GLIBC = (2, 28)

# It finds the interpreter behind a virtual environment: an environment built on another one would
# break with it. `-I` ignores the PYTHONPATH of the caller.
_PROBE = """
import importlib.util, json, os, sys, sysconfig
path = sys.executable
if sys.prefix != sys.base_prefix:
    path = os.path.join(sys.base_prefix, 'bin', 'python%d.%d' % sys.version_info[:2])
variant = '' if sys.implementation.name == 'cpython' else sys.implementation.name
if sysconfig.get_config_var('Py_GIL_DISABLED'):
    variant = 'free-threaded'
print(json.dumps([os.path.realpath(path), list(sys.version_info[:3]), variant,
                  all(importlib.util.find_spec(m) is not None for m in ('venv', 'ensurepip'))]))
"""


class SetupError(Exception):
    """A set-up that cannot continue; the message is a sentence: what is wrong and what to do."""


class Interpreter(NamedTuple):
    """A Python interpreter."""

    name: str  #: as requested, e.g. ``python3``
    path: str  #: the base executable, links resolved
    version: Tuple[int, int, int]
    variant: str  #: '' for the usual CPython; `free-threaded`, or another implementation
    has_venv: bool

    @property
    def fits(self) -> bool:
        """Whether the packages of this project have wheels for it."""
        return not self.variant and self.version[:2] in SUPPORTED_VERSIONS

    def __str__(self) -> str:
        return f'{self.name} is {".".join(map(str, self.version))} {self.variant}'.rstrip()


def run_python(
    python: str, code: str, env: Optional[Mapping[str, str]] = None, flags: Sequence[str] = ()
) -> Optional[str]:
    """Return the output of `python` for `code`, or None if it does not run."""
    try:
        return subprocess.check_output(
            [python, *flags, '-c', code],
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
            universal_newlines=True,
            env=env,
            timeout=60,
        )
    except (OSError, subprocess.SubprocessError):
        return None


def probe(name: str) -> Optional[Interpreter]:
    """Return the facts about the interpreter called `name`, or None if it does not run."""
    out = run_python(name, _PROBE, flags=['-I'])
    if out is None:
        return None
    path, version, variant, has_venv = json.loads(out)
    return Interpreter(name, path, tuple(version), variant, has_venv)


def choose_interpreter(found: Sequence[Interpreter], asked: Optional[str] = None) -> Interpreter:
    """Return the first interpreter that fits the project.

    `asked` is the name that the user requires, if any; then `found` holds at most that one.
    """
    fitting = [python for python in found if python.fits]
    for python in fitting:
        if python.has_venv:
            return python
    if fitting:
        major, minor, _ = fitting[0].version
        raise SetupError(
            f"Python's venv module is missing from {fitting[0].path}: install it (on Debian and "
            f'Ubuntu: `sudo apt install python{major}.{minor}-venv`), then run the same command '
            'again.'
        )
    seen = '; '.join(str(python) for python in found)
    if not seen:
        seen = f'`{asked}` does not run' if asked else f'none of {", ".join(CANDIDATES)} runs'
    raise SetupError(
        f'CPython 3.10, 3.11, 3.12 or 3.13 is needed, but here {seen}: install one of them, or '
        'name one: `make setup PYTHON=/path/to/python3.12`.'
    )


def platform_problem(system: str, machine: str, glibc: Optional[Tuple[int, ...]]) -> Optional[str]:
    """Return why the ROS 2 wheels cannot run here, in one sentence, or None if they can."""
    if system == 'Linux' and machine == 'x86_64' and glibc is not None and glibc >= MINIMUM_GLIBC:
        return None
    libc = 'another C library' if glibc is None else 'glibc ' + '.'.join(map(str, glibc))
    return (
        'Without a ROS 2 Jazzy installation this project needs x86-64 Linux with glibc 2.28 or '
        f'later, but this is {machine} {system} with {libc}: install ROS 2 Jazzy here (it is then '
        'used), or work on such a Linux or in a container of it.'
    )


def this_platform() -> Tuple[str, str, Optional[Tuple[int, ...]]]:
    """Return (system, machine, glibc version) of this machine; no version without glibc."""
    # Not platform.libc_ver: that of Python 3.6 reads an older version from its own executable.
    try:
        name, _, version = (os.confstr('CS_GNU_LIBC_VERSION') or '').partition(' ')
    except (AttributeError, ValueError, OSError):  # macOS and musl do not have this name
        name = version = ''
    glibc = tuple(int(part) for part in version.split('.')[:2]) if name == 'glibc' else None
    return platform.system(), platform.machine(), glibc


def find_ros(
    environ: Mapping[str, str], is_file: Callable[[str], bool] = os.path.isfile
) -> Optional[str]:
    """Return the prefix of the ROS 2 Jazzy installation to use, or None for the wheels.

    First RPO_ROS_PREFIX if it is set (empty: the wheels), then a sourced Jazzy, then the usual
    place. A virtual environment on AMENT_PREFIX_PATH holds wheels, ours or of another checkout.
    """
    if ROS_PREFIX_VARIABLE in environ:
        named = environ[ROS_PREFIX_VARIABLE].rstrip('/')
        if named and not is_file(f'{named}/setup.bash'):
            raise SetupError(
                f'{ROS_PREFIX_VARIABLE} names no ROS 2 installation: {named}/setup.bash does not '
                'exist; correct it, or set it empty to use the wheels.'
            )
        return named or None
    distro = environ.get('ROS_DISTRO', ROS_DISTRO)
    if distro != ROS_DISTRO:
        raise SetupError(
            f'ROS 2 {distro} is sourced in this shell, and this project needs ROS 2 {ROS_DISTRO}: '
            'run the same command in a shell where it is not sourced.'
        )
    for prefix in filter(None, environ.get('AMENT_PREFIX_PATH', '').split(':')):
        if is_file(f'{prefix}/share/rclpy/package.xml') and not is_file(f'{prefix}/pyvenv.cfg'):
            for base in (prefix, os.path.dirname(prefix)):  # merged or isolated layout
                if is_file(f'{base}/setup.bash'):
                    return base
    return DEFAULT_ROS_PREFIX if is_file(f'{DEFAULT_ROS_PREFIX}/setup.bash') else None


def ros_environment(prefix: str, environ: Mapping[str, str]) -> Dict[str, str]:
    """Return the environment after sourcing the installation at `prefix`."""
    done = subprocess.run(
        ['bash', '-c', '. "$1/setup.bash" >/dev/null && env -0', 'bash', prefix],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        universal_newlines=True,
        env=dict(environ),
    )
    if done.returncode != 0:
        raise SetupError(
            f'Sourcing {prefix}/setup.bash fails ({done.stderr.strip() or "no message"}): repair '
            f'that ROS 2 installation, or set {ROS_PREFIX_VARIABLE} empty to use the wheels.'
        )
    return dict(item.split('=', 1) for item in done.stdout.split('\0') if '=' in item)


def interpreter_for_ros(
    found: Sequence[Interpreter], prefix: str, env: Mapping[str, str]
) -> Interpreter:
    """Return the first interpreter that imports the rclpy of the installation at `prefix`."""
    imports = 'import numpy, rclpy'
    usable = [python for python in found if run_python(python.path, imports, env) is not None]
    if usable:
        return choose_interpreter(usable)
    tried = '; '.join(str(python) for python in found) or 'no interpreter runs'
    raise SetupError(
        f'No Python here imports rclpy and numpy of the ROS 2 installation {prefix} ({tried}): '
        'name the one it was built for (`make setup PYTHON=/usr/bin/python3`), or set '
        f'{ROS_PREFIX_VARIABLE} empty to use the wheels.'
    )
