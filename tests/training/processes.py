# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo` as a process of its own, as on another processor where a test wants one."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpo_core.control.controller import load_controller

CONFIGURATIONS = ('config.yaml', 'family.yaml', 'tuning.yaml')
ENTRY = 'from rpo.cli.entry import main; main()'

ANOTHER = {'OPENBLAS_CORETYPE': 'Haswell', 'NPY_DISABLE_CPU_FEATURES': 'AVX512_ICL'}
"""What a processor without AVX-512 would choose; any with AVX2 can compute so."""


def python(
    code: str, *arguments: object, environment: Mapping[str, str] | None = None, limit_s: float = 55
) -> subprocess.CompletedProcess[str]:
    """Run Python with strict warnings; arithmetic is what the environment asks for."""
    command = [sys.executable, '-W', 'error::ImportWarning', '-c', code, *map(str, arguments)]
    return subprocess.run(
        command,
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        timeout=limit_s,
        check=False,
    )


def rpo(
    *arguments: object, environment: Mapping[str, str] | None = None, limit_s: float = 55
) -> subprocess.CompletedProcess[str]:
    """Run the command `rpo`."""
    return python(ENTRY, *arguments, environment=environment, limit_s=limit_s)


def repeated(command: str, folder: Path, *words: str, limit_s: float = 850) -> Any:
    """Return the controller that a command `rpo train` makes, in its own process."""
    plots = ['--no-plots'] if '--preset' in command else []
    done = rpo(*command.split()[1:], *words, *plots, '-o', folder, limit_s=limit_s)
    assert done.returncode in (0, 1), done.stderr
    (made,) = (path for path in folder.glob('*.yaml') if path.name not in CONFIGURATIONS)
    return load_controller(made)


def stopped(
    path: Path, folder: Path, number: int, *words: str
) -> tuple[subprocess.Popen[str], str]:
    """Signal a campaign that has saved some results; return its process, and its errors.

    All processes of its group get the signal, as from a terminal.
    """
    process = subprocess.Popen(
        [sys.executable, '-c', ENTRY, 'campaign', str(path), '-o', str(folder), *words],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'COLUMNS': '200'},
        start_new_session=True,
    )
    deadline, done = time.monotonic() + 60.0, folder / 'done.part'
    while time.monotonic() < deadline:
        if done.is_file() and (folder / 'campaign.yaml').is_file() and any(done.read_bytes()):
            break
        time.sleep(0.02)
    os.killpg(process.pid, number)
    return process, process.communicate(timeout=60)[1]
