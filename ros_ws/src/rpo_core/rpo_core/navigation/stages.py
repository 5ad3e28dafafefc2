# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The sections that this folder adds to scenario files; `rpo_core.plugins` imports it."""

from rpo_core.navigation import (
    attitude_estimator,
    attitude_sensors,
    estimator,
    navigation_errors,
    sensors,
)

__all__ = ['attitude_estimator', 'attitude_sensors', 'estimator', 'navigation_errors', 'sensors']
