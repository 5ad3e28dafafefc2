# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What each stage adds to the tick of the engine: one module each, registered there."""
