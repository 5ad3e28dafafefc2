# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning of baseline controllers: a tuning space for each kind, searched like a training.

A new baseline needs its law in `rpo_core` and its space in `tuning_spaces`.
"""
