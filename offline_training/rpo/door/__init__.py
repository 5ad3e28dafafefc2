# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What `import rpo` offers, one subject a module; the package loads them as they are asked for."""
