# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Changes true folders in every way that a forger can, and looks whether a checker is deceived."""
