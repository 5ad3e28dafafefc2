# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Writing a run: messages in any order of arrival in, the same bytes for the same run out.

Nothing in here may raise into the flight, wait for the disk, or look at the wall clock to decide
what it writes.
"""
