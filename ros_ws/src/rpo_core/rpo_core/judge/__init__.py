# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is required of a flight, and how it is judged: metrics, verdicts, contact, similarity."""
