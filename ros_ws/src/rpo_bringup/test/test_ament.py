# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The style checks that ROS runs, where they are installed: of this package and those beside it.

Not ament_copyright: it knows no SPDX headers. The project's own tests are in `tests`.
"""

from pathlib import Path

import pytest

OWN = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent for path in OWN.parent.glob('rpo_*/package.xml'))


@pytest.fixture(params=PACKAGES, ids=lambda path: path.name)
def package(request):
    """Each package."""
    return request.param


def test_flake8(package):
    """What differs from ament's defaults stands, with the reasons, in setup.cfg."""
    flake8 = pytest.importorskip('ament_flake8.main')
    config = OWN / 'setup.cfg'
    code, errors = flake8.main_with_errors(argv=['--config', str(config), str(package)])
    assert code == 0, '\n'.join(errors)


def test_pep257(package):
    """Docstrings are numpydoc's; properties are things (D401), magic methods need none."""
    pep257 = pytest.importorskip('ament_pep257.main')
    options = ['--convention', 'numpy', '--add-ignore', 'D105', 'D107', 'D401', '--']
    assert pep257.main(argv=[*options, str(package / package.name)]) == 0


def test_xml(package):
    """package.xml follows its schema, launch files are well-formed."""
    xmllint = pytest.importorskip('ament_xmllint.main')
    assert xmllint.main(argv=[str(package)]) == 0
