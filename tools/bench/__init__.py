# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Speed, measured beside the peers: targets P1 to P5, `rpo bench`."""
