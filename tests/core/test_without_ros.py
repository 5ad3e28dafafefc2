# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The core needs no ROS: everything here passes in an interpreter where importing rclpy fails."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from core_oracles import python

from rpo_core.files.validation import missing_library

BLOCKED = """
import sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('rclpy', 'rpyutils', 'rosidl_parser', 'nav_msgs', 'rpo_ros'):
            raise ImportError(f'{name} is blocked in this test')

sys.meta_path.insert(0, NoRos())
try:
    import rclpy
except ImportError as error:
    assert 'blocked' in str(error)
else:
    sys.exit('rclpy is not blocked')
"""
TESTS = """
import pytest
code = pytest.main(sys.argv[1:])
loaded = sorted(name for name in sys.modules if name.split('.')[0] == 'rclpy')
sys.exit(int(code) or len(loaded))
"""


def test_it_is_said_how_to_install_the_one_library_that_rosdep_has_not(monkeypatch):
    said = missing_library('mcap.reader')
    assert said.startswith('the Python library mcap is missing: `python3 -m pip install ')
    assert missing_library('rosbags.rosbag2').endswith('rosbags` installs it')
    assert missing_library('rclpy') is None and missing_library(None) is None
    for prefix, options in (('/own', 'install mcap'), ('/usr', '--break-system-packages mcap')):
        monkeypatch.setattr(sys, 'prefix', prefix)
        monkeypatch.setattr(sys, 'base_prefix', '/usr')
        assert f'{options}`' in missing_library('mcap')


@pytest.mark.slow
def test_all_tests_of_the_core_pass_with_rclpy_blocked():
    here = Path(__file__)
    # Fewer examples, not this test again; test_bits starts interpreters of its own, and what the
    # peers need is not for us to say.
    others = [here, *map(here.with_name, ('test_bits.py', 'test_fuzzy_peers.py'))]
    report = python(
        BLOCKED + TESTS,
        str(here.parent),
        *[f'--ignore={path}' for path in others],
        '--quiet',
        '--deselect=tests/core/test_cdr.py::test_as_the_middleware_writes_it',  # its oracle is ROS
        RPO_HYPOTHESIS_PROFILE='smoke',
    )
    assert ' passed' in report and 'skipped' not in report, report
