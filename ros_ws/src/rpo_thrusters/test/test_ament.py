# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The style checks that ROS runs on its packages, where they are installed.

Not ament_copyright: it knows no SPDX headers. The project's own tests are in `tests`.
"""

from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1]


def test_flake8():
    """What differs from ament's defaults stands, with the reasons, in setup.cfg."""
    flake8 = pytest.importorskip('ament_flake8.main')
    config = PACKAGE / 'setup.cfg'
    code, errors = flake8.main_with_errors(argv=['--config', str(config), str(PACKAGE)])
    assert code == 0, '\n'.join(errors)


def test_pep257():
    """Docstrings are numpydoc's; properties are things (D401), magic methods need none."""
    pep257 = pytest.importorskip('ament_pep257.main')
    options = ['--convention', 'numpy', '--add-ignore', 'D105', 'D107', 'D401', '--']
    assert pep257.main(argv=[*options, str(PACKAGE / PACKAGE.name)]) == 0


def test_xml():
    """package.xml follows its schema, launch files are well-formed."""
    xmllint = pytest.importorskip('ament_xmllint.main')
    assert xmllint.main(argv=[str(PACKAGE)]) == 0
