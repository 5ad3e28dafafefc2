# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = 'rpo_ros'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['loopback.xml', 'loopback_3.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
)
