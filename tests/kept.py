# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lists that lie beside tests: what code says today, so that a change of it is seen.

Tests of what must hold find what is wrong. A bound that is wider than it must be: only a
list finds it. `KEEP=1 pytest -k list` writes the lists anew; a person reads what
changed in them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def digits(values: Iterable[Any]) -> str:
    """Return numbers by seven digits: the last ones differ between mathematical libraries."""
    return ' '.join(f'{value:.7g}' if abs(value) > 1e-9 else '0' for value in values)


def assert_kept(path: Path, lines: Iterable[str]) -> None:
    """Assert that a list has these lines; with `KEEP` in the environment, write them."""
    found = list(lines)
    if 'KEEP' in os.environ:
        path.write_text(''.join(f'{line}\n' for line in found))
    kept = path.read_text().splitlines()
    others = sorted({*kept} ^ {*found})
    said = f'on purpose? then `KEEP=1 pytest -k list` writes {path.name} anew: {others[:9]}'
    assert found == kept, said
