# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The file that says all of a flight: scenario, requirements, changes by `--set`."""
