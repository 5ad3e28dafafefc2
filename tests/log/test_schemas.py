# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Schemas and type hashes against rosbags, which computes both on its own."""

from __future__ import annotations

import re

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rpo_core.wire import interfaces
from rpo_log.errors import Fault, LogError
from rpo_log.format import schemas

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = sorted({row.type for row in interfaces.rows()})


@pytest.mark.parametrize('name', TYPES)
def test_hash_is_that_of_the_type(name):
    assert schemas.definition(name).type_hash == STORE.hash_rihs01(name)


@pytest.mark.parametrize('name', TYPES)
def test_text_defines_the_type_and_what_it_needs(name):
    text = schemas.definition(name).text
    parsed = get_types_from_msg(text, name)
    theirs, _ = STORE.generate_msgdef(name, ros_version=2)
    wanted = get_types_from_msg(theirs, name)
    assert parsed.keys() == wanted.keys()
    for dependency, (_, fields) in wanted.items():
        assert parsed[dependency][1] == fields
    headings = re.findall(r'^={80}\nMSG: (.*)$', text, re.MULTILINE)
    assert len(headings) == len(set(headings)) == len(wanted) - 1


def test_says_where_it_looked(monkeypatch, tmp_path):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.setattr('sys.prefix', str(tmp_path / 'prefix'))
    schemas.definition.cache_clear()
    with pytest.raises(LogError, match=r'Clock\.msg.*ROS environment') as found:
        schemas.definition('rosgraph_msgs/msg/Clock')
    schemas.definition.cache_clear()
    assert found.value.fault is Fault.NO_DEFINITIONS
    assert str(tmp_path) in str(found.value)
