# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What `rpo log` does with logs: look into one, compare two, export; and `rpo repair`."""
