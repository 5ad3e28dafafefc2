# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What every node shares: QoS profiles, message conversions, parameter tables, clean start and stop."""
