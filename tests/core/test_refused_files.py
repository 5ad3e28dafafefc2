# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of scenarios and controllers that are refused, each in one sentence."""

from pathlib import Path
from typing import Any

import pytest
from core_documents import MISSING, changed, document, refusal

from rpo_core import files

ROWS = files.load(Path(__file__).with_name('refused.yaml'), dict)
CASES = [(base, changes, said) for base, rows in ROWS.items() for changes, said in rows]
OUTAGES = [[float(i), i + 1.0] for i in range(101)]
MANY = {'kind': 'range_bearing', 'bearing_noise_rad': 0.002, 'outages_s': OUTAGES}
CASES.append(('scenario quick', {'sensors': {'units': [MANY]}}, 'a list of at most 100'))


@pytest.mark.parametrize(('base', 'changes', 'said'), CASES)
def test_what_cannot_be_is_one_sentence(base: str, changes: dict[str, Any], said: str):
    kind, name = base.split()
    data = document(kind, name)
    for key, value in changes.items():
        path = tuple(int(part) if part.isdigit() else part for part in key.split('.'))
        data = changed(data, path, MISSING if value is None else value)
    assert said in refusal(kind, data)
