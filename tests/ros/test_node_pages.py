# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""docs/nodes is what the nodes are: tables, topics, services as they run today."""

from pathlib import Path

from test_launch_files import executables

from tools import node_pages
from tools.node_pages import CARDS, MEANINGS

ROOT = Path(__file__).parents[2]
COMMANDS = {'final_approach', 'flight_software', 'node_pages', 'ping_pong'}
COMMANDS |= {'verify', 'info', 'repair'}
"""Executables that are no nodes."""


def test_the_pages_are_not_stale(ros_env):
    written = {path.name: path.read_text() for path in (ROOT / 'docs' / 'nodes').iterdir()}
    found = node_pages.pages()
    stale = sorted(name for name in {*written, *found} if written.get(name) != found.get(name))
    assert not stale, 'write them anew: ros2 run rpo_bringup node_pages docs/nodes'
    said = ''.join(found.values())
    assert '| publishes | `/tf` | `tf2_msgs/TFMessage` |' in found['visualizer.md']
    unused = [name for name in MEANINGS if f'`{name}`' not in said]
    assert not unused, 'no node has them any more'


def test_every_node_has_its_page():
    scripts = {name for _, name in executables()}
    assert scripts - COMMANDS == {card.executable for card in CARDS}
