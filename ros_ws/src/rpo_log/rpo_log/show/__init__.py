# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a person sees of a run: the table, the picture, and the style of every picture."""
