# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'rpo_bringup'
# Programs of tools/ run in a checkout alone: they are installed only from one, with links to it.
linked = (Path(__file__).resolve().parents[3] / 'tools').is_dir() and 'develop' in sys.argv
of_tools = [
    'node_pages = rpo_bringup.commands:node_pages',
    'ping_pong = rpo_bringup.commands:ping_pong',
    'trial = rpo_bringup.commands:trial',
]

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', sorted(glob('config/*.yaml'))),
        (f'share/{package_name}/config/scenarios', sorted(glob('config/scenarios/*.yaml'))),
        (f'share/{package_name}/config/monitors', sorted(glob('config/monitors/*.yaml'))),
        (f'share/{package_name}/launch', sorted(glob('launch/*.launch.*'))),
        (f'share/{package_name}/rviz', sorted(glob('rviz/*.rviz'))),
        (f'share/{package_name}/foxglove', sorted(glob('foxglove/*.json'))),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    entry_points={
        'console_scripts': [
            'final_approach = rpo_bringup.commands:final_approach',
            'flight_software = rpo_bringup.commands:flight_software',
            'monitor = rpo_bringup.commands:monitor',
            *(of_tools if linked else []),
        ],
    },
)
