# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The lock files: complete, hashed, of one mind, and free of any registry's address."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from packaging.markers import Marker, default_environment
from packaging.requirements import Requirement

REQUIREMENTS = Path(__file__).resolve().parents[2] / 'ros_ws' / 'underlay' / 'requirements'
LIMITS = {'constraints', 'overrides'}
LAYERS = sorted({path.stem for path in REQUIREMENTS.glob('*.in')} - LIMITS)


def locked(layer: str) -> list[tuple[Requirement, list[str]]]:
    """Return (requirement, hashes) of every entry of a lock file."""
    text = (REQUIREMENTS / f'{layer}.txt').read_text()
    joined = re.sub(r'#.*', '', text).replace('\\\n', ' ')
    entries = []
    for line in filter(None, map(str.strip, joined.splitlines())):
        requirement, *hashes = re.split(r'\s+--hash=', line)
        entries.append((Requirement(requirement), hashes))
    return entries


def versions_for(layer: str, python: str) -> dict[str, str]:
    """Return name -> version that a Python on Linux installs of a layer."""
    environment = {
        **default_environment(),
        'python_version': python,
        'python_full_version': f'{python}.1',
        'sys_platform': 'linux',
    }
    chosen: dict[str, str] = {}
    for requirement, _ in locked(layer):
        marker: Marker | None = requirement.marker
        if marker is None or marker.evaluate(environment):
            assert requirement.name not in chosen, f'{requirement.name} twice for {python}'
            chosen[requirement.name] = str(requirement.specifier)
    return chosen


@pytest.mark.parametrize('layer', LAYERS)
def test_every_entry_is_one_version_with_sha256_hashes_and_no_address(layer):
    for requirement, hashes in locked(layer):
        assert re.fullmatch(r'==[^*,]+', str(requirement.specifier)), requirement
        assert hashes, f'{requirement} has no hash'
        assert all(re.fullmatch('sha256:[0-9a-f]{64}', value) for value in hashes)
    text = (REQUIREMENTS / f'{layer}.txt').read_text()
    assert not re.search(r'://|--(extra-)?index-url|--find-links|^-[if] ', text, re.MULTILINE)


@pytest.mark.parametrize('python', ['3.10', '3.11', '3.12', '3.13'])
def test_layers_have_what_they_name_and_agree_on_versions(python):
    all_versions: dict[str, str] = {}
    for layer in LAYERS:
        versions = versions_for(layer, python)
        for name, version in versions.items():
            assert all_versions.setdefault(name, version) == version, f'{name} in {layer}'
        text = (REQUIREMENTS / f'{layer}.in').read_text()
        lines = filter(None, map(str.strip, re.sub('#.*', '', text).splitlines()))
        assert {Requirement(x).name.lower() for x in lines if x[:2] != '-r'} <= set(versions)
