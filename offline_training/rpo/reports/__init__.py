# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of runs, campaigns and controllers: pictures, and one page that needs nothing else.

`run`, `campaign`, `controller`, `training` say what stands on a page; modules `*_plots` draw;
`page` has the blocks of a page, and writes it. The page loads nothing from the network.
"""
