# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

package_name = 'rpo_ctrl'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        *(
            (f'share/{package_name}/{folder}', sorted(glob(f'{folder}/*.yaml')))
            for folder in ('config/controllers', 'config/attitude_controllers')
        ),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    entry_points={
        'console_scripts': [
            'attitude_controller = rpo_ctrl.commands:attitude_controller',
            'fuzzy_controller = rpo_ctrl.commands:fuzzy_controller',
            'rival_controller = rpo_ctrl.commands:rival_controller',
        ],
    },
)
