# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Shipped scenarios made shorter or longer."""

from __future__ import annotations

from pathlib import Path

import yaml

import rpo_core.files


def lasting(duration_s: float, folder: Path, name: str = 'approach') -> str:
    """Write a shipped scenario with another duration into a folder; return the file's path."""
    document = yaml.safe_load(rpo_core.files.shipped('scenario')[name].read_text())
    path = folder / f'{name}_{duration_s:g}_s.yaml'
    path.write_text(yaml.safe_dump({**document, 'duration_s': duration_s}))
    return str(path)
