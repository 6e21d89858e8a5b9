"""Layer under a roller: its plies, a lift below it, and the rate at which a roller compacts it."""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import accumulate
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array
from compact.numerics.validation import require_inside, require_positive, require_that

BaseCondition = Literal["bonded", "slip"]

HEIGHT_TOLERANCE = 1e-9  # [-], of the layer height; rounding of decimal thicknesses


@dataclass(frozen=True, kw_only=True)
class Ply:
    """Ply of a layer.

    Parameters
    ----------
    thickness : float
        Thickness [m], > 0.
    stiffness : float
        Relative modulus: moduli of the ply over those of the material [-], > 0.
    """

    thickness: float
    stiffness: float

    def __post_init__(self) -> None:
        require_positive(thickness=self.thickness, stiffness=self.stiffness)


@dataclass(frozen=True, kw_only=True)
class LowerLift:
    """Lift below the fed one, of the same mix, compacted by an earlier pass and bonded to it.

    Parameters
    ----------
    thickness : float
        Thickness at rest [m], > 0.
    density_ratio : float
        Density ratio k at rest [-], 0 < k < 1; at the same time that of its preconsolidation.
    residual_stress : bool
        True for the lateral stress that confined compression leaves behind, False for mix without stress.
    """

    thickness: float
    density_ratio: float
    residual_stress: bool = True

    def __post_init__(self) -> None:
        require_positive(thickness=self.thickness)
        require_inside(0, 1, density_ratio=self.density_ratio)

    def compaction_rate(self, speed: float, radius: float, fed_density_ratio: float) -> float:
        """Compute the rate of compaction in the earlier pass [1/s], see `compaction_rate`.

        Parameters
        ----------
        speed, radius : float
            Speed [m/s] and radius [m] of the roller.
        fed_density_ratio : float
            Initial density ratio of the mix [-].
        """
        fed_height = self.thickness * self.density_ratio / fed_density_ratio
        return compaction_rate(speed, radius, fed_height, fed_height - self.thickness)


@dataclass(frozen=True)
class Layer:
    """Layer on a rigid base, of one material or of plies, or lift of mix on a lower lift.

        E(y, t) = c(y) E(t),  c the relative modulus of the ply at y

    The plies are bonded to one another and share Poisson's ratio and the relaxation spectrum of the material.

    Parameters
    ----------
    height : float
        Height H [m], > 0; that of the mix as fed where it compacts.
    base : {"bonded", "slip"}
        Bonded or frictionless base.
    plies : tuple of Ply
        Plies from the base upwards; without plies the layer has the relative modulus 1.
    lower_lift : LowerLift, optional
        Lift between the layer and the base, under mix that compacts; the height does not contain it.

    Raises
    ------
    ValueError
        If the thicknesses do not add up to the height, or a layer with a lower lift has plies.
    """

    height: float
    _: KW_ONLY
    base: BaseCondition = "bonded"
    plies: tuple[Ply, ...] = ()
    lower_lift: LowerLift | None = None

    def __post_init__(self) -> None:
        require_positive(height=self.height)
        object.__setattr__(self, "plies", tuple(self.plies))
        total = sum(ply.thickness for ply in self.plies)
        rule = f"the thicknesses of `plies` must add up to the layer height, {self.height!r} m, got"
        require_that(not self.plies or abs(total - self.height) <= HEIGHT_TOLERANCE * self.height, total, rule)
        count = len(self.plies)
        require_that(not count or self.lower_lift is None, count, "a layer with a `lower_lift` has no `plies`, got")

    @cached_property
    def stack(self) -> tuple[Ply, ...]:
        """Plies from the base upwards, at least one."""
        return self.plies or (Ply(thickness=self.height, stiffness=1.0),)

    @property
    def top(self) -> Ply:
        """Ply in contact with the roller."""
        return self.stack[-1]

    @cached_property
    def interfaces(self) -> tuple[float, ...]:
        """Heights of the interfaces between plies [m], ascending."""
        return tuple(accumulate(ply.thickness for ply in self.stack[:-1]))

    def stiffness(self, y: ArrayLike) -> Array:
        """Return the relative modulus c [-] at heights y [m] off the interfaces."""
        return np.array([ply.stiffness for ply in self.stack])[np.searchsorted(self.interfaces, y)]


def compaction_rate(speed: float, radius: float, fed_height: float, depth: float) -> float:
    """Compute the mean rate of compaction under a roller [1/s].

        rate = |v| ln(k_out/k_in)/a,    k_out/k_in = H/(H - d),    a = sqrt(2 R d)

    Density ratio and contact length are nominal: those of mix that is pressed from its height as fed to the lowest
    generatrix without elastic recovery, and of a rigid parabola in a plane. The rate is thus an explicit function of
    speed and geometry for every engine. Mix that an earlier pass has compacted counts as fed, so that a second pass at
    the same height has the rate of the first.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    radius : float
        Roller radius R [m].
    fed_height : float
        Height H of all mix below the roller at its initial density ratio [m].
    depth : float
        Depth d of the lowest generatrix below that height [m], less than H; 0 is the rate of a touching roller.

    Examples
    --------
    >>> f"{compaction_rate(0.13, 0.11, 0.063, 0.003):.3f} 1/s"
    '0.247 1/s'
    """
    if depth <= 0:
        return 0.0
    return float(-abs(speed) * np.log1p(-depth / fed_height) / np.sqrt(2 * radius * depth))
