# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What annotations call arrays of numbers."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
