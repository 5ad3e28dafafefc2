# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The scenarios that ship."""

from pathlib import Path

import pytest

from rpo_core.files import scenario

FILES = sorted(Path(__file__).resolve().parents[1].glob('config/scenarios/*.yaml'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_a_shipped_file_is_a_scenario(path):
    """It is one without an error, and has the name of its file."""
    assert scenario.load(str(path)).name == path.stem


def test_they_are_here():
    """The paper's test and its training are among them."""
    assert {'paper_test', 'paper_training', 'quick'} <= {path.stem for path in FILES}
