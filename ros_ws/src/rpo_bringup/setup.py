# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
from setuptools import setup

scripts = [
    'final_approach = rpo_bringup.commands:final_approach',
    'flight_software = rpo_bringup.commands:flight_software',
    'ping_pong = rpo_bringup.commands:ping_pong',
    'visualizer = rpo_bringup.commands:visualizer',
    'web = rpo_bringup.commands:web',
]
scripts += [
    f'{name} = rpo_core.files.gone:executable' for name in ('monitor', 'node_pages', 'trial')
]

setup(entry_points={'console_scripts': scripts})  # setup.cfg says the rest
