# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Regenerate the lock files of `requirements/`; needs a package index.

One resolution of all layers together fixes every version (`versions.txt`). The file of each layer
then holds its own packages at those versions, with hashes. Locked versions that still fit stay,
except with `--upgrade`.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parent / 'requirements'
LIMITS = ('constraints.in', 'overrides.in')
OLDEST_PYTHON = '3.10'
SYSTEM_PYTHON, SYSTEM_NUMPY = '3.12', '1.26.4'  # ROS 2 Jazzy on Ubuntu 24.04


def compile_lock(*arguments: str) -> None:
    """Run `uv pip compile` with the options that all locks share."""
    command = [str(Path(sys.executable).with_name('uv')), 'pip', 'compile', '--quiet']
    command += ['--no-annotate', '--custom-compile-command', 'make lock']
    # Two packages, of Python alone, have no wheel.
    command += ['--only-binary', ':all:', '--no-binary', 'empy', '--no-binary', 'oem']
    command += ['--constraint', 'constraints.in', *arguments]
    env = {**os.environ, 'UV_PYTHON_DOWNLOADS': 'never'}
    done = subprocess.run(
        command, cwd=str(REQUIREMENTS), env=env, stderr=subprocess.PIPE, text=True
    )
    if done.returncode != 0:
        raise SystemExit(
            f'lock: uv found no versions that fit (exit code {done.returncode}):\n{done.stderr}'
        )


def check_system_numpy(layers: list[str]) -> None:
    """Fail unless the locked versions also accept the NumPy beside an installed ROS 2."""
    versions = (REQUIREMENTS / 'versions.txt').read_text().splitlines()
    pins = [line for line in versions if not line.startswith('numpy==')]
    untrue = (REQUIREMENTS / 'overrides.in').read_text().splitlines()
    with tempfile.TemporaryDirectory() as scratch:
        constraints = Path(scratch) / 'pins.txt'
        constraints.write_text('\n'.join([*pins, f'numpy=={SYSTEM_NUMPY}', '']))
        overrides = Path(scratch) / 'overrides.txt'  # without NumPy, which is checked here
        overrides.write_text('\n'.join(line for line in untrue if not line.startswith('numpy')))
        compile_lock(
            *(f'{layer}.in' for layer in layers if layer != 'ros'),
            *('--python-version', SYSTEM_PYTHON, '--constraint', str(constraints)),
            *('--override', str(overrides)),
            *('--output-file', str(Path(scratch) / 'answer.txt')),
        )


def main() -> None:
    """Lock all layers."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog='example: make lock UPGRADE=1'
    )
    parser.add_argument('--upgrade', action='store_true', help='move to the newest versions')
    upgrade = ['--upgrade'] if parser.parse_args().upgrade else []
    layers = sorted(path.stem for path in REQUIREMENTS.glob('*.in') if path.name not in LIMITS)
    universal = ['--universal', '--python-version', OLDEST_PYTHON, '--override', 'overrides.in']

    print(f'lock: choosing versions for {", ".join(layers)}', flush=True)
    sources = [f'{layer}.in' for layer in layers]
    compile_lock(*sources, *universal, *upgrade, '--output-file', 'versions.txt')
    for layer in layers:
        print(f'lock: {layer}.txt', flush=True)
        compile_lock(
            *(f'{layer}.in', *universal, '--generate-hashes', '--upgrade'),
            *('--constraint', 'versions.txt', '--output-file', f'{layer}.txt'),
        )
    print(f'lock: checking the versions against numpy {SYSTEM_NUMPY}', flush=True)
    check_system_numpy(layers)


if __name__ == '__main__':
    main()
