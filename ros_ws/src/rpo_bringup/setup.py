# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

from setuptools import setup

# Programs of tools/ run in a checkout alone: they are installed only from one, with links to it.
linked = (Path(__file__).resolve().parents[3] / 'tools').is_dir() and 'develop' in sys.argv
of_tools = [
    'node_pages = rpo_bringup.commands:node_pages',
    'ping_pong = rpo_bringup.commands:ping_pong',
    'trial = rpo_bringup.commands:trial',
]
scripts = [
    'final_approach = rpo_bringup.commands:final_approach',
    'flight_software = rpo_bringup.commands:flight_software',
]

setup(entry_points={'console_scripts': scripts + of_tools * linked})  # setup.cfg says the rest
