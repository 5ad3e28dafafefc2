# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Set the project up: virtual environment, locked packages, colcon build.

If all is in place, it does nothing, in a moment and without the network. The next call repairs an
interrupted or damaged set-up. It uses an installed ROS 2 Jazzy if there is one, else the wheels.
"""

import argparse
import contextlib
import fcntl
import os
import sys
import time
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Sequence

import host
from host import Interpreter, SetupError
from layers import Environment, Identity, say
from workspace import Workspace

ROOT = Path(__file__).resolve().parents[2]
# Variables of another ROS shell, or of our own; sourcing must start without them. Without bytecode
# a build takes twice as long.
_NOT_FOR_A_BUILD = (
    'AMENT_PREFIX_PATH',
    'CMAKE_PREFIX_PATH',
    'COLCON_PREFIX_PATH',
    'LD_LIBRARY_PATH',
    'PYTHONPATH',
    'PYTHONDONTWRITEBYTECODE',
    '_ROS_WHEELS_BOOTSTRAP_COMPLETE',
)


@contextlib.contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Lock the set-up of this checkout; wait while another one holds the lock."""
    with path.open('a+') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say('another set-up of this checkout is running; waiting for it')
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def underlay_environment(ros_prefix: str) -> Dict[str, str]:
    """Return the environment variables for the build of ROS 2 packages."""
    environ = {k: v for k, v in os.environ.items() if k not in _NOT_FOR_A_BUILD}
    return host.ros_environment(ros_prefix, environ) if ros_prefix else environ


def choose(asked: Optional[str], ros_prefix: str, last: Optional[Identity]) -> Interpreter:
    """Return the interpreter for a new environment; that of the last environment if possible."""
    names: List[str] = [asked] if asked else list(host.CANDIDATES)
    if last is not None and not asked:
        names.insert(0, last.python)
    if ros_prefix and not asked:
        names.append('/usr/bin/python3')  # a pyenv or conda may come first on the PATH
    found = [python for python in map(host.probe, names) if python is not None]
    if ros_prefix:
        env = underlay_environment(ros_prefix)
        return host.interpreter_for_ros(found, ros_prefix, env)
    problem = host.platform_problem(*host.this_platform())
    if problem:
        raise SetupError(problem)
    return host.choose_interpreter(found, asked)


def ros_for(current: Optional[Identity]) -> str:
    """Return the prefix of the ROS 2 to use, empty for the wheels.

    An environment on an installation keeps it while it exists, whether this shell has sourced it or
    not.
    """
    found = host.find_ros(os.environ)
    if found or host.ROS_PREFIX_VARIABLE in os.environ or current is None:
        return found or ''
    return current.ros_prefix if os.path.isfile(f'{current.ros_prefix}/setup.bash') else ''


def reason_to_rebuild(venv: Environment, asked: Optional[str], ros_prefix: str) -> Optional[str]:
    """Return why the environment cannot stay as it is, or None if it can."""
    have = venv.identity
    if have is None:
        return 'it is not complete' if venv.path.exists() else 'there is none yet'
    if have.root != str(ROOT):
        return f'it was made in {have.root}'
    if have.ros_prefix != ros_prefix:
        return f'it uses {have.ros_prefix or "the ROS 2 wheels"}'
    if venv.record.get('installing'):
        return 'an installation into it was interrupted'
    if not venv.runs():
        return f'its interpreter {have.python} is missing or has changed'
    if asked:
        python = host.probe(asked)
        if python is None or python.path != have.python:
            return f'it is made with {have.python}'
    return None


def set_up(asked: Optional[str], layers: Sequence[str]) -> None:
    """Bring environment, layers and build up to date with the checkout."""
    if any(character in str(ROOT) for character in ' \t\n:;"\''):
        raise SetupError(
            f'The path of this checkout, `{ROOT}`, holds a space, quote or colon, which the build '
            'tools of ROS 2 cannot handle: move the checkout.'
        )
    venv = Environment(ROOT)
    venv.check_layers(layers)
    workspace = Workspace(ROOT / 'ros_ws')
    ros_prefix = ros_for(venv.identity)
    reason = reason_to_rebuild(venv, asked, ros_prefix)
    if reason:
        venv.create(choose(asked, ros_prefix, venv.identity), ros_prefix, reason)
        workspace.wipe()  # built executables name their interpreter
    missing = venv.missing(layers)
    if missing:
        venv.install(missing)
    venv.install_editable(ROOT / 'offline_training')
    venv.link_packages(workspace.packages())
    outdated = workspace.outdated()
    if outdated:
        workspace.build(venv.python, underlay_environment(ros_prefix), outdated)


def parse_arguments(argv: Optional[Sequence[str]] = None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        epilog='example: python3 ros_ws/underlay/bootstrap.py --python python3.12 train report',
    )
    parser.add_argument(
        'layers', nargs='*', metavar='LAYER', help='layers of requirements/ in addition to `fly`'
    )
    parser.add_argument('--python', metavar='PATH', help='the interpreter to build on')
    return parser.parse_args(argv)


def main() -> int:
    """Set up; return the exit code."""
    arguments = parse_arguments()
    start = time.monotonic()
    try:
        with only_one(ROOT / 'ros_ws' / '.setup.lock'):
            set_up(arguments.python or None, arguments.layers)
    except SetupError as error:
        print(f'[setup] {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('\n[setup] interrupted; the same command continues from here', file=sys.stderr)
        return 130
    seconds = time.monotonic() - start
    if seconds > 1.5:
        say(f'ready after {seconds:.0f} s')
    return 0


if __name__ == '__main__':
    sys.exit(main())
