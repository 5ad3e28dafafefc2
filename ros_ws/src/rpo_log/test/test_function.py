# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The command `verify` without a log, where ROS 2 is not running."""

from rpo_log.log_commands import parser


def test_the_options_of_verify_are_read(tmp_path):
    """A run folder, and keys that are trusted."""
    options = parser('verify').parse_args([str(tmp_path), '--trusted', 'keys'])
    assert options.path == tmp_path and str(options.trusted) == 'keys'
