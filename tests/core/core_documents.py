# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenario and controller documents to spoil, and what a refusal must say."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import pytest
import yaml

from rpo_core import files
from rpo_core.control import controller
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.scenario.requirements import ATTITUDES, THRUST, Requirements

PARSERS = {
    'scenario': scenario.parse,
    'controller': controller.parse,
}

Path = tuple[Any, ...]
"""Keys and indices from the top of a document down to a value."""

MISSING = object()


def shipped_text(kind: str, name: str) -> str:
    """Return the text of a file that ships."""
    return files.find(kind, name).read_text()


def document(kind: str, name: str) -> Any:
    """Return a shipped file as plain Python, read without our own reader."""
    return yaml.safe_load(shipped_text(kind, name))


def with_harmonic() -> Any:
    """Return a scenario document whose disturbance is written out."""
    data = document('scenario', 'quick')
    harmonic = {'axis': 'y', 'function': 'sin', 'amplitude_n': -0.022, 'angular_rate_rad_s': 3.6e-3}
    data['disturbance'] = {
        'constant_n': [0.0, 0.01, 0.0],
        'harmonics': [{**harmonic, 'phase_rad': 1.0}],
    }
    return data


def changed(data: Any, path: Path, value: Any) -> Any:
    """Return a copy of a document with one value replaced, or taken out (`MISSING`)."""
    data = copy.deepcopy(data)
    parent = data
    for key in path[:-1]:
        parent = parent[key]
    if value is MISSING:
        del parent[path[-1]]
    else:
        parent[path[-1]] = value
    return data


def renamed(data: Any, path: Path, name: str) -> Any:
    """Return a copy of a document with one key renamed, in its place."""
    parent = data
    for key in path[:-1]:
        parent = parent[key]
    items = {name if key == path[-1] else key: value for key, value in parent.items()}
    return changed(data, path[:-1], items) if len(path) > 1 else items


def keys(data: Any, prefix: Path = ()) -> list[Path]:
    """Return the path of every mapping key in a document."""
    found: list[Path] = []
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        path = (*prefix, key)
        found += [path] if isinstance(data, dict) else []
        found += keys(value, path) if isinstance(value, (dict, list)) else []
    return found


def name(path: Path) -> str:
    """Return a path as our messages write it: `a.b[0].c`."""
    return ''.join(f'[{p}]' if isinstance(p, int) else f'.{p}' for p in path).lstrip('.')


def refusal(kind: str, data: Any) -> str:
    """Return the message with which a document is refused; it names its file first."""
    content = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
    with pytest.raises(InputError) as error:
        files.loads(content, PARSERS[kind], 'mine.yaml')
    message = str(error.value)
    assert message.startswith('mine.yaml: '), message
    assert '\n' not in message and len(message) < 400, message
    return message


def with_hardware() -> Any:
    """Return a scenario whose thrusters and navigation have errors."""
    data = document('scenario', 'quick')
    data['thrusters'] = {'matrix': [[1, 0, 0], [0, 1, 0], [0, 0, 1]], 'delay_ticks': 1}
    data['navigation'] = {
        'position_bias_m': [0.1, 0, 0], 'velocity_bias_m_s': [0, 0, 0],
        'position_noise_m': 0.1, 'velocity_noise_m_s': 0.01, 'noise_key': [1, 2],
    }  # fmt: skip
    return data


def with_requirements() -> Any:
    """Return a scenario that requires all that can be required without pulses and propellant."""
    data = document('scenario', 'quick')
    names = {f.name for f in dataclasses.fields(Requirements)} - set(THRUST)
    required = {name: 1.0 for name in sorted(names)}
    data['requirements'] = {**required, 'contact_axis': '+y', 'profile': 'idss'}
    for key in ATTITUDES:  # of a chaser that turns
        del data['requirements'][key]
    del data['requirements']['arrival_error_norm_m']  # per axis or norm, not both
    return data


DOCUMENTS = {
    ('scenario', 'requirements'): with_requirements(),
    ('scenario', 'paper_test'): document('scenario', 'paper_test'),
    ('scenario', 'paper_training'): document('scenario', 'paper_training'),
    ('scenario', 'harmonics'): with_harmonic(),
    ('scenario', 'hardware'): with_hardware(),
    **{
        ('controller', n): document('controller', n)
        for n in ['handmade', 'pd', 'lqr', 'mpc', 'apf_smc', 'drift', 'more_words', 'time_to_go']
    },
}
"""Kind and name -> a document of each kind of section and controller."""
