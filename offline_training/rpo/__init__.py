# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The door: fly, judge, train, disperse, prove and report, by name."""

from pathlib import Path

from rpo_core import files

files.SHIPPED['campaign'] = Path(__file__).parent / 'shipped' / 'campaigns'
