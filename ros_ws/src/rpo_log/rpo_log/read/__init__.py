# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reading a run: records of a file, messages, blocks of ticks, the whole log in memory.

Everything that is wrong with a file is a `LogError`, found here and nowhere else. Memory is bounded
but for `run_log`, which holds a whole log.
"""
