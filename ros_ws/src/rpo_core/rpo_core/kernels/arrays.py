# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What annotations call arrays of numbers, and their sums of products."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def contracted(subscripts: str, *arrays: Floats) -> Floats:
    """Return `np.einsum`, and zeros where an axis has no length.

    There NumPy 2.4 multiplies memory that is not the arrays' own by zero: where that holds no
    number, neither does the sum.
    """
    found: Floats = np.einsum(subscripts, *arrays)
    return found if all(array.size for array in arrays) else np.zeros_like(found)
