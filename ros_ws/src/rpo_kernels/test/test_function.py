# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Inference and saturation, without files."""

from rpo_kernels.kernels import memberships, saturate


def test_a_sample_has_five_grades():
    """At zero the word zero holds alone; beyond the limit a force is the limit."""
    assert memberships(0.0, (0.2, 0.0, 0.5, 1.0, 0.5)) == (0.0, 0.0, 1.0, 0.0, 0.0)
    assert saturate(3.0, 0.5) == 0.5
