# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What flies between stages: the table of interfaces, bytes of messages, statuses."""
