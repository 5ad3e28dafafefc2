# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes share: QoS, conversions, parameter tables, start and stop."""
