# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The target is a body: how it turns, and motion as it is seen from its axes."""
