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
            ('share/ament_index/resource_index/packages', ['resource/rpo_core']),
            ('share/rpo_core', ['package.xml']),
        ],
    )
