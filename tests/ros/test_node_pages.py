# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of the nodes that the site has: tables, topics, services as they run today."""

import node_pages
from node_pages import CARDS, MEANINGS
from test_launch_files import executables

from rpo_core.files.gone import GONE

COMMANDS = {'final_approach', 'flight_software', 'ping_pong'}
COMMANDS |= {'verify', 'info', 'repair', *GONE['executable']}
"""Executables that are no nodes."""


def test_every_node_has_its_page_and_every_meaning_a_node(ros_env):
    found = node_pages.pages()
    assert set(found) == set(node_pages.NAMES)
    said = ''.join(found.values())
    assert '| publishes | `/tf` | `tf2_msgs/TFMessage` |' in found['visualizer.md']
    unused = [name for name in MEANINGS if f'`{name}`' not in said]
    assert not unused, 'no node has them any more'


def test_every_executable_has_a_card():
    scripts = {name for _, name in executables()}
    assert scripts - COMMANDS == {card.executable for card in CARDS}
