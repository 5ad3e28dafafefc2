# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `rpo`: each subcommand is a module of `commands`."""
