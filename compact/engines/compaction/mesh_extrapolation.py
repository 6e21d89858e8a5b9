"""Load in the limit of fine meshes, and the errors by the mesh, from the steady states on three meshes.

The load converges with first order in the element length, always from above on the lifts that were computed with 28 and
42 elements per contact length. With the loads P_c and P of meshes of n_c and n elements per contact length,

    P_limit = P + (P - P_c)/(n/n_c - 1)

Its error is a share of the correction, or of the change of P_limit from the pair of meshes before, whichever is larger:
on thin layers the loads scatter with the edges of the contact, and two meshes may agree by chance. Where the first
mesh has no steady state, the error is the whole correction. The resistance converges with order 1.5. Its error is the
mean of those by two pairs of meshes, and at least the residual of the work balance.

All meshes are compared at what is prescribed on the last one, by the exponents of the forces over the depth.
"""

import numpy as np

from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.steady_search import SteadySearch
from compact.rolling_contact import MIN_RESISTANCE_RATIO

COARSE_INCREMENTS = 4  # [-], elements per contact length of the first mesh
RATIO, FIRST_RATIO = np.sqrt(2), 2.0  # [-], of the elements of the last two meshes, and of those before
MIN_FIRST_RATIO = 1.4  # [-], of the elements of the first two meshes
ORDERS = np.array([1.0, 1.5])  # [-], of load and resistance in the element length
CORRECTION_SHARE = 0.5  # [-], error of the extrapolated load over its correction or change; covers eight of nine lifts


def mesh_cascade(increments: int) -> list[int]:
    """Return the numbers of elements per contact length of successive meshes."""
    counts = [increments]
    while round(counts[0] / (ratio := RATIO if len(counts) < 2 else FIRST_RATIO)) >= COARSE_INCREMENTS:
        counts.insert(0, round(counts[0] / ratio))
    if counts[0] >= MIN_FIRST_RATIO * COARSE_INCREMENTS:
        counts.insert(0, COARSE_INCREMENTS)
    return counts


def mesh_errors(fine: SteadySearch) -> tuple[float, float] | None:
    """Return the relative errors of load and resistance by the mesh [-]; None without a coarser mesh.

    Parameters
    ----------
    fine : SteadySearch
        Search on the last mesh, with those on the coarser ones.
    """
    coarse = fine.coarse
    if coarse is None:
        return None
    load, resistance = fine.values[:2] * [fine.load_factor, 1.0]
    corrections = (fine.values - coarse.values_at(fine.depth))[:2] * remaining_shares(coarse, fine)
    errors, change, share = np.abs(corrections), 0.0, 1.0
    if coarse.coarse is not None and coarse.coarse.is_steady:
        at_coarse = coarse.values_at(fine.depth)
        before = (at_coarse - coarse.coarse.values_at(fine.depth))[:2] * remaining_shares(coarse.coarse, coarse)
        errors[1] = (errors[1] + abs(before[1]) * (coarse.elements / fine.elements) ** ORDERS[1]) / 2
        change, share = float(at_coarse[0] + before[0] - load), CORRECTION_SHARE
    if fine.load_factor != 1:
        errors[0] = share * max(errors[0], abs(change))
    scale = max(abs(resistance), MIN_RESISTANCE_RATIO * load)
    return float(errors[0] / load), float(errors[1] / scale)


def remaining_shares(coarse: SteadySearch, fine: SteadySearch) -> FloatArray:
    """Return the errors of load and resistance on the fine mesh over the changes from the coarse one [-]."""
    return np.asarray(1 / ((fine.elements / coarse.elements) ** ORDERS - 1))
