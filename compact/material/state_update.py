"""Own material law: the stress of a point as a function of its strain history, given by a state update.

    stress, state, tangent = update(state, strain)

The interface is that of a user material of a finite-element program (UMAT, MFront), in Python and without side effects.
A point moves along its streamline; the law receives the strain increments in turn and returns the stress after each.

    component       0      1      2      3
    strain          e_xx   e_yy   e_zz   2 e_xy     increment, logarithmic, in the frame that rotates with the material
    stress          s_xx   s_yy   s_zz   s_xy       Cauchy [Pa]
    tangent[i, j]   derivative of stress i with respect to strain j [Pa]

x is the travel, y the height; tension is positive. Time does not enter: the law is independent of the rate.

The engine "column" rolls over such a material (`engines.column.state_update_columns`), and `api.results`
applies the laboratory tests. The engine "compaction" does not take it: its elements integrate the points in compiled
code together with their own tangents, which a Python function would slow down a thousandfold.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compact.numerics import Array
from compact.numerics.validation import require_finite, require_inside

COMPONENTS = 4  # [-], of stress and strain

Update = Callable[[Any, Array], tuple[Array, Any, Array]]


@dataclass(frozen=True, eq=False)
class StateUpdate:
    """Own material law.

    Parameters
    ----------
    update : callable
        `update(state, strain) -> (stress, state, tangent)` with arrays of shape (4,), (4,) and (4, 4). It returns a new
        state and leaves the given one as it is, because the solvers repeat increments.
    initial_state : object
        State of mix at rest as fed, of any kind.
    fed_density_ratio : float
        Density ratio of that mix [-], 0 < k < 1; later ones follow from the volume.
    name : str
        Name of the material in messages.

    Examples
    --------
    >>> stiffness = 1e6 * np.diag([1.0, 1.0, 1.0, 0.5])
    >>> def update(stress, strain):
    ...     stress = stress + stiffness @ strain
    ...     return stress, stress, stiffness
    >>> mix = StateUpdate(update, initial_state=np.zeros(4), fed_density_ratio=0.94)
    >>> stress, state, tangent = mix.advance(mix.initial_state, np.array([0.0, -0.01, 0.0, 0.0]))
    >>> stress.tolist()
    [0.0, -10000.0, 0.0, 0.0]
    """

    update: Update
    initial_state: Any
    fed_density_ratio: float
    name: str = "own material"

    def __post_init__(self) -> None:
        if not callable(self.update):
            raise ValueError(f"`update` must be a function of state and strain, got {self.update!r}")
        require_inside(0, 1, fed_density_ratio=self.fed_density_ratio)

    def advance(self, state: Any, strain: Array) -> tuple[Array, Any, Array]:
        """Apply one strain increment.

        Parameters
        ----------
        state : object
            State before the increment.
        strain : ndarray, shape (4,)
            Increment [-].

        Returns
        -------
        stress : ndarray, shape (4,)
            Stress after the increment [Pa].
        state : object
            State after the increment.
        tangent : ndarray, shape (4, 4)
            Derivative of the stress [Pa].

        Raises
        ------
        ValueError
            If the law returns values of other shapes, or that are not finite.
        """
        try:
            stress, after, tangent = self.update(state, strain)
            stress, tangent = np.asarray(stress, dtype=float), np.asarray(tangent, dtype=float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"`update` of {self.name} must return (stress, state, tangent): {error}") from error
        if stress.shape != (COMPONENTS,) or tangent.shape != (COMPONENTS, COMPONENTS):
            raise ValueError(
                f"`update` of {self.name} must return a stress of shape (4,) and a tangent of shape (4, 4), got "
                f"{stress.shape} and {tangent.shape}"
            )
        require_finite(stress=stress, tangent=tangent)
        return stress, after, tangent
