# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The machine of the measurements."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

PACKAGES = ('numpy', 'numba', 'pymoo', 'pyfuzzylite', 'ros-jazzy-rclpy')


def model() -> str:
    """Return the name of the processor."""
    try:
        with open('/proc/cpuinfo') as file:
            return next(line.split(':')[1].strip() for line in file if 'model name' in line)
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def load_per_core() -> float:
    """Return the load average of the last minute, per core of this process."""
    return os.getloadavg()[0] / len(os.sched_getaffinity(0))


def facts() -> dict[str, Any]:
    """Return processor, cores, load and versions."""
    return {
        'processor': model(),
        'cores': len(os.sched_getaffinity(0)),
        'load_per_core': round(load_per_core(), 2),
        'system': platform.platform(),
        'python': platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return 'not a Python package here'


def machine() -> str:
    """Return the machine in words."""
    python, numpy = platform.python_version(), version('numpy')
    return f'{model()}, Python {python}, NumPy {numpy}'
