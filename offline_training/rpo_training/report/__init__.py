# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of runs, campaigns and controllers: pictures, and one page that needs nothing else."""
