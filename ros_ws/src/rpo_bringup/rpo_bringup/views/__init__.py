# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Live views of a run: visualizer (RViz), web (a page)."""
