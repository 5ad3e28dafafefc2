# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

from setuptools import setup

if {'sdist', 'dist_info', 'bdist_wheel'} & {*sys.argv}:  # pip and uv: the modules alone
    setup(long_description=Path('README.md').read_text(), python_requires='>=3.10')
else:  # colcon
    setup(
        data_files=[
            ('share/ament_index/resource_index/packages', ['resource/rpo_log']),
            ('share/rpo_log', ['package.xml']),
        ],
        entry_points={
            'console_scripts': [
                'recorder = rpo_log.commands:recorder',
                'replay = rpo_log.commands:replay',
                'verify = rpo_log.commands:verify',
                'info = rpo_log.commands:info',
                'repair = rpo_core.files.gone:executable',
            ],
        },
    )
