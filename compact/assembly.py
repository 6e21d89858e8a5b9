"""Batched element matrices of plane-strain solids, shared by the finite-element engines.

    K_e = int B' C B dA of all elements at once;  dof d of component i is unknown 2 d + i
"""

import numpy as np
from scipy.sparse import coo_matrix

