# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What moves: Clohessy-Wiltshire motion, true orbits, disturbance; zones, faulty links."""
