"""Error estimate of a steady solution: mesh, drift and start, at what is prescribed.

mesh    change between the last two meshes over (fine/coarse)^order - 1, with order 1 for the load and 1.5 for the
        resistance at a given depth; at least half of what the change of the bow wave makes, since the forces of two
        meshes may agree by chance. Ten random lifts, 14 against 24 elements per contact length, bound the orders.
drift   distance to the steady state along the slow mode, before the last jump
start   scatter of that distance, and the transient that is not part of the mode

At a given load, peak pressure or density both meshes are compared at the prescribed value. The resistance then takes
over the drift of the load, times its exponent.
"""

from dataclasses import dataclass

import numpy as np

from compact.engines.compaction.bow_wave import QUANTITIES
from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.steady_search import SteadySearch

MIN_RESISTANCE = 1e-3  # [-], least scale of the error of the resistance over the load
DEPTH_EXPONENTS = np.array([1.2, 2.3, 1.0, 0.6])  # [-], of `QUANTITIES` over the depth; of the density: its increase
ORDERS = np.array([1.0, 1.5])  # [-], of load and resistance in the element length
WAVE_SHARE = 0.5  # [-], of the change of a force by that of the wave, the least change between two meshes


@dataclass(frozen=True)
class ErrorParts:
    """Estimated relative errors of load and resistance [-], pairs.

    Parameters
    ----------
    mesh : tuple of float, or None
        Error of the finite elements; None for a single mesh.
    drift : tuple of float
        Distance to the steady state.
    start : tuple of float
        Scatter and transient.
    """

    mesh: tuple[float, float] | None
    drift: tuple[float, float]
    start: tuple[float, float]

    @property
    def total(self) -> tuple[float, float] | None:
        """Sums of the parts for load and resistance [-]; None without an estimate of the mesh."""
        if self.mesh is None:
            return None
        load, resistance = np.sum([self.mesh, self.drift, self.start], axis=0)
        return float(load), float(resistance)


def error_parts(search: SteadySearch, mesh: tuple[float, float] | None) -> ErrorParts:
    """Return the errors of a steady solution.

    Parameters
    ----------
    search : SteadySearch
        Search that has found the steady state.
    mesh : tuple of float, or None
        Relative errors of load and resistance by the mesh [-].
    """
    drift, start = (_at_target(part, search) for part in (search.errors.drift, search.errors.start))
    return ErrorParts(mesh, drift, start)


def mesh_errors(coarse: SteadySearch, fine: SteadySearch) -> tuple[float, float]:
    """Return the relative errors of load and resistance by the mesh from the solutions on two of them [-].

    Parameters
    ----------
    coarse, fine : SteadySearch
        Searches that have found the steady state.
    """
    elements = [search.rolling.frame.contact_length / search.rolling.frame.step for search in (coarse, fine)]
    by_depth = fine.target.quantity != "load"  # at a given load the resistance takes over the order of the load
    remaining = 1 / ((elements[1] / elements[0]) ** (ORDERS if by_depth else ORDERS[:1]) - 1)
    change = np.abs(_at_same_target(coarse, fine) - fine.values)
    mode = fine.relaxation.mode
    if mode is not None and fine.target.quantity == "indentation":
        wave = fine.rolling.steps[-1].wave_area - coarse.rolling.steps[-1].wave_area
        change = np.maximum(change, WAVE_SHARE * np.abs(mode.slopes * wave))
    relative = remaining * change[:2] / _scales(fine)
    return float(relative[0]), float(relative[1])


def _at_same_target(coarse: SteadySearch, fine: SteadySearch) -> FloatArray:
    """Return the values of a coarse solution at the prescribed value of the fine one; targets are met loosely."""
    quantity, values = fine.target.quantity, coarse.values
    if quantity == "indentation":
        return values
    index = QUANTITIES.index(quantity)
    miss = coarse.target.log_miss(float(values[index])) - fine.target.log_miss(float(fine.values[index]))
    return values * np.exp(-miss * DEPTH_EXPONENTS / DEPTH_EXPONENTS[index])


def _at_target(errors: FloatArray, search: SteadySearch) -> tuple[float, float]:
    """Return the errors of load and resistance at what is prescribed."""
    load, resistance = (float(error) for error in errors[:2] / _scales(search))
    if search.target.quantity != "load":
        return load, resistance
    return 0.0, resistance + float(DEPTH_EXPONENTS[1] / DEPTH_EXPONENTS[0]) * load


def _scales(search: SteadySearch) -> FloatArray:
    """Return load and resistance, the latter not too small, as scales of their errors [N/m], shape (2,)."""
    load, resistance = np.abs(search.values[:2])
    return np.array([load, max(resistance, MIN_RESISTANCE * load)])
