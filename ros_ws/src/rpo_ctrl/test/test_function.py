# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The controller files that ship."""

from pathlib import Path

import pytest

from rpo_core.control.controller import load_controller

FILES = sorted(Path(__file__).resolve().parents[1].glob('config/controllers/*.yaml'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_a_shipped_file_is_a_controller(path):
    """It is one without an error, and has the name of its file."""
    assert load_controller(str(path)).name == path.stem


def test_they_are_here():
    """The default and the paper's own are among them."""
    assert {'allround', 'paper_ga'} <= {path.stem for path in FILES}
