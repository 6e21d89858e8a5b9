"""Array types, and numerical methods shared by the packages: validation, piecewise functions, programs, assembly."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
