# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
from setuptools import setup

setup()  # setup.cfg says the rest
