"""Rolling resistance as a function of speed and acceleration: dry friction, first-order expansion, sampled map.

To first order in the acceleration the resistance of a viscoelastic layer is

    F(v, a) ~ F_ss(v) + a M(v).

F_ss is odd and M even in v. M is an added mass due to the memory of the layer, whose surface under an accelerating
roller corresponds to a lower speed. Its limits, for gaps measured vertically, are

    v -> 0     M -> -t dF_ss/dv,  t = sum share time^2/sum share time
    v -> inf   M ~ 1/v^3.

For gaps normal to the circle on the deformed surface the lag is longer by about the indentation over the radius. The
prescribed quantity (indentation, load or peak pressure) is constant in time. Inertia of layer and roller is excluded.
Confined-compression columns depend on the path only, so that M = 0; so does a rate-independent compacting layer.

A `ResistanceMap` samples an engine over the speeds of a motion:

    F(v, a) = F(v) + a' M(v),    a' = a for |a| <= A, else A sign(a),    A = UNSTEADINESS_LIMIT |v|/tau

F and M are cubic splines over ln |v|; F is monotone where its samples are. For v < 0 both are multiplied by a constant
ratio if the return stroke rolls over compacted mix. Below the slowest sample F follows the power law v^n of the two
slowest samples, 0 <= n <= 1 (1 for a relaxing layer, 0 for a rate-independent one), and M is constant. The error of the
map is a cross-validation error: each sample is predicted by the others, and samples are added where that fails. At rest
the resistance is set-valued; the call returns the middle, 0.

The expansion is valid for an unsteadiness |a| tau/|v| below UNSTEADINESS_LIMIT, hence never at a reversal. Beyond, the
added-mass term is held at its limit: it is continuous and zero at rest. On a Winkler foundation (operating point,
Eg/Er 1.5, tau 0.1 s, four laws) the largest error of a pass of 3 s is 0.16-0.41 of the peak force without M and
0.14-0.39 with it; of a pass of 0.6 s, mostly beyond the limit, 0.8-1.6 with both. Without the limit M halves the
root-mean-square error in 3 s, but errs by 1.4-50 peak forces in 0.6 s. Near a reversal, and for a few tau after a jump
of the acceleration, the history matters, which the unsteadiness does not measure.

References
----------
F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238 (monotone cubic interpolation).
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from compact.numerics import Array, BoolArray
from compact.numerics.validation import as_numbers, require_finite, require_nonnegative, require_positive

UNSTEADINESS_LIMIT = 0.1  # [-], |a| tau/|v| at which the expansion errs by at most 0.4 % on a Winkler foundation
MIN_ROWS = 2  # [-], of a table; its error is unknown with as many
MIN_SAMPLES = 5  # [-], initial samples of a map
MAX_SAMPLES = 64  # [-], samples of a map
BLOCK_SIZE = 8192  # [-], speeds evaluated together; they fit in the processor cache
MIN_SPEED_RATIO = 1e-6  # [-], slowest sample over the fastest speed
SPEED_REDUCTION = 4.0  # [-], ratio of the slowest samples added while the power law fails
SPEED_ROUNDING = 1e-9  # [-], by which a speed may exceed the fastest sample
COLUMNS, UNITS = ("speed", "resistance", "added_mass"), ("m/s", "N", "kg")  # of the file of a map
NUMBERS = ("error", "engine_error", "relaxation_time", "return_ratio")  # of a map, attributes of its file


@dataclass(frozen=True)
class DryResistance:
    """Dry friction: a force of constant magnitude against the motion.

    Parameters
    ----------
    force : float
        Magnitude F [N], >= 0. At velocity 0 the resistance is set-valued, -F to F: the call returns the middle, 0, and
        a drive with a cart that may stick reads the limit from `force`.
    """

    force: float

    def __post_init__(self) -> None:
        require_nonnegative(force=self.force)

    def __call__(self, velocity: ArrayLike, acceleration: ArrayLike) -> Array:
        """Return F sign(velocity) [N], of the common shape of velocity [m/s] and acceleration [m/s2]."""
        velocity, _ = np.broadcast_arrays(as_numbers("velocity", velocity), as_numbers("acceleration", acceleration))
        return self.force * np.sign(velocity)

    def scaled(self, factor: float) -> "DryResistance":
        """Return the resistance times a factor."""
        return DryResistance(factor * self.force)


def dry_resistance(force: float) -> DryResistance:
    """Return a constant resistance that opposes the motion in either direction (dry friction).

        R(v, a) = force sign(v)

    Parameters
    ----------
    force : float
        Magnitude [N], >= 0.

    Returns
    -------
    DryResistance
        Resistance for `simulate` and the other drives. A plain constant, `lambda v, a: 3486.0`, would accelerate the
        cart on the return stroke and is refused.

    Examples
    --------
    >>> resistance = dry_resistance(3486.0)
    >>> [float(resistance(v, 0.0)) for v in (-0.2, 0.0, 0.2)]
    [-3486.0, 0.0, 3486.0]
    """
    return DryResistance(force)


@dataclass(frozen=True)
class ResistanceExpansion:
    """First-order expansion of the resistance of one roller about a steady speed, per unit roller length.

    Parameters
    ----------
    speed : float
        Speed v [m/s].
    resistance : float
        Steady resistance F_ss [N/m].
    slope : float
        Derivative dF_ss/dv [N s/m2].
    added_mass : float
        Added mass M [N s2/m2].
    error : float, optional
        Estimated absolute error of the added mass [N s2/m2]; None without an estimate. M changes its sign.
    relaxation_time : float
        Longest relaxation time tau [s]; 0 for an elastic layer.
    """

    speed: float
    resistance: float
    slope: float
    added_mass: float
    error: float | None
    relaxation_time: float


class ForceSample(NamedTuple):
    """Resistance by one contact.

    Parameters
    ----------
    speed : float
        Speed [m/s], > 0.
    force : float
        Resistance [N].
    error : float or None
        Relative error estimate of the engine [-].
    noise : float
        Relative scatter between contacts at neighbouring speeds [-], the part of the error that they do not share.
    """

    speed: float
    force: float
    error: float | None
    noise: float = 0.0


@dataclass(frozen=True, eq=False)
class ResistanceMap:
    """Sampled resistance over speed and acceleration; call it with velocities [m/s] and accelerations [m/s2].

    Parameters
    ----------
    speeds : ndarray, shape (n,)
        Speeds of the samples [m/s], > 0, ascending.
    forces : ndarray, shape (n,)
        Resistance of the samples [N].
    error : float
        Largest cross-validation error of a sample over the largest force [-].
    engine_error : float, optional
        Largest relative error estimate of the engine for a sample [-].
    added_masses : ndarray, shape (n,), optional
        Added mass M of the samples [kg]; None where it is unknown and neglected.
    relaxation_time : float
        Longest relaxation time tau [s]; 0 for a mix without memory.
    return_ratio : float
        Resistance of the return stroke, v < 0, over that of the forward stroke [-].
    contacts : tuple of ForceSample
        Contacts of the law whose values the samples are; empty where the samples themselves are contacts.
    """

    speeds: Array
    forces: Array
    error: float
    engine_error: float | None = None
    added_masses: Array | None = None
    relaxation_time: float = 0.0
    return_ratio: float = 1.0
    contacts: tuple[ForceSample, ...] = ()

    odd = True  # either sign is accepted: a driven roller pulls its cart

    def __call__(self, velocity: ArrayLike, acceleration: ArrayLike = 0.0) -> Array:
        """Evaluate the resistance [N], of the common shape of velocity and acceleration.

        Parameters
        ----------
        velocity, acceleration : array_like
            Velocity [m/s] and acceleration [m/s2].

        Raises
        ------
        ValueError
            If a speed exceeds the fastest sample.
        """
        velocity, acceleration = as_numbers("velocity", velocity), as_numbers("acceleration", acceleration)
        fastest = np.max(np.abs(velocity), initial=0.0)
        if fastest > self.speeds[-1] * (1 + SPEED_ROUNDING):
            raise ValueError(
                f"the resistance was computed up to {self.speeds[-1]:g} m/s, got {fastest:g} m/s; sample it over the "
                "speeds of the motion"
            )
        velocity, acceleration = np.broadcast_arrays(np.asarray(velocity, float), np.asarray(acceleration, float))
        count = velocity.size // BLOCK_SIZE + 1
        blocks = zip(*(np.array_split(each.ravel(), count) for each in (velocity, acceleration)), strict=True)
        return np.concatenate([self._evaluate(*block) for block in blocks]).reshape(velocity.shape)[()]

    def _evaluate(self, velocity: Array, acceleration: Array) -> Array:
        slowest, speed = self.speeds[0], np.abs(velocity)
        values = self.splines(np.log(np.clip(speed, slowest, self.speeds[-1])))
        force = np.sign(velocity) * values[:, 0]
        if self.exponent and np.any(speed < slowest):
            force = force * np.minimum(speed / slowest, 1.0) ** self.exponent
        if self.added_masses is not None:
            if self.relaxation_time:
                largest = self.rate_limit * speed
                acceleration = np.clip(acceleration, -largest, largest)
            force = force + acceleration * values[:, 1]
        return force if self.return_ratio == 1 else np.where(velocity < 0, self.return_ratio, 1.0) * force

    @property
    def rate_limit(self) -> float:
        """Largest |a|/|v| at which the added-mass term is linear [1/s]; infinite without memory."""
        return UNSTEADINESS_LIMIT / self.relaxation_time if self.relaxation_time else np.inf

    def is_unsteady(self, velocity: ArrayLike, acceleration: ArrayLike) -> BoolArray:
        """Return True where |a| tau/|v| reaches `UNSTEADINESS_LIMIT`, as at a reversal; False at rest."""
        changes = self.relaxation_time * np.abs(np.asarray(acceleration, float))
        return (changes > 0) & (changes >= UNSTEADINESS_LIMIT * np.abs(velocity))

    @cached_property
    def splines(self) -> PPoly:
        """Return splines of F, and of M where it is known, over ln v."""
        columns = [self.forces] if self.added_masses is None else [self.forces, self.added_masses]
        splines = [_monotone_spline(self.speeds, values) for values in columns]
        return PPoly(np.stack([spline.c for spline in splines], axis=-1), splines[0].x)

    @cached_property
    def exponent(self) -> float:
        """Exponent n of the power law below the slowest sample [-]."""
        return _power_law_exponent(self.speeds, self.forces)

    @property
    def computed(self) -> tuple[ForceSample, ...]:
        """Contacts from which the map was computed, in ascending order of the speed."""
        pairs = zip(self.speeds.tolist(), self.forces.tolist(), strict=True)
        return self.contacts or tuple(ForceSample(*pair, self.engine_error) for pair in pairs)

    def scaled(self, factor: float) -> "ResistanceMap":
        """Return the map with all forces and added masses multiplied by a factor [-]."""
        masses = None if self.added_masses is None else factor * self.added_masses
        contacts = tuple(each._replace(force=factor * each.force) for each in self.contacts)
        return replace(self, forces=factor * self.forces, added_masses=masses, contacts=contacts)

    def save(self, path: Path) -> None:
        """Write the map as netCDF with the versions of the program."""
        import xarray

        from compact.files import NETCDF_CLASSIC, versions, write_netcdf

        columns: dict[str, Any] = {
            name: ("speed", values, {"units": unit}, {"_FillValue": None})
            for name, values, unit in zip(COLUMNS, (self.speeds, self.forces, self.added_masses), UNITS, strict=True)
            if values is not None
        }
        if self.contacts:
            table = np.array(self.contacts, dtype=float)  # an unknown error is nan
            columns["contacts"] = (("contact", "quantity"), table, {}, {"_FillValue": None})
        numbers = {name: float(np.nan if (value := getattr(self, name)) is None else value) for name in NUMBERS}
        attributes = {"versions": json.dumps(versions())} | numbers
        write_netcdf(path, xarray.Dataset(columns, attrs=attributes), NETCDF_CLASSIC)


def load_resistance_map(path: str | Path) -> ResistanceMap:
    """Read a map written by `ResistanceMap.save`."""
    from compact.files import NETCDF_CLASSIC, read_netcdf

    table = read_netcdf(path, NETCDF_CLASSIC)
    columns = {name: np.array(variable, dtype=float) for name, variable in table.variables.items()}
    numbers: dict[str, Any] = {name: float(table.attrs[name]) for name in NUMBERS}
    numbers["engine_error"] = _known(numbers["engine_error"])
    rows = columns.get("contacts", np.empty((0, 4))).tolist()
    contacts = tuple(ForceSample(at, force, _known(error), noise) for at, force, error, noise in rows)
    forces, masses = columns["resistance"], columns.get("added_mass")
    return ResistanceMap(columns["speed"], forces, added_masses=masses, contacts=contacts, **numbers)


def _known(error: float) -> float | None:
    return None if np.isnan(error) else error


def tabulated_resistance(
    speeds: ArrayLike, forces: ArrayLike, added_masses: ArrayLike | None = None, relaxation_time: float = 0.0
) -> ResistanceMap:
    """Return the resistance of a table of measured or computed forces over the speed.

    Parameters
    ----------
    speeds : array_like, shape (n,)
        Speeds [m/s], > 0, ascending, n >= 2.
    forces : array_like, shape (n,)
        Resistance of one cart at these speeds [N], against the motion.
    added_masses : array_like, shape (n,), optional
        Added masses [kg]; none by default.
    relaxation_time : float
        Longest relaxation time of the mix [s], which limits the effect of the acceleration; 0 without memory.

    Returns
    -------
    ResistanceMap
        Its error is the largest difference between a row and its prediction by the other rows, over the largest force.

    Raises
    ------
    ValueError
        If the columns differ in length, are not finite, or the speeds do not ascend from a positive value.

    Examples
    --------
    >>> resistance = tabulated_resistance((0.05, 0.1, 0.2, 0.4), (2.9e3, 3.1e3, 3.3e3, 3.5e3))
    >>> [round(float(resistance(v))) for v in (-0.2, 0.2, 0.3)]
    [-3300, 3300, 3417]
    """
    given = {"speeds": speeds, "forces": forces, "added_masses": 0.0 if added_masses is None else added_masses}
    speeds, forces, masses = (np.asarray(as_numbers(name, column), float) for name, column in given.items())
    if speeds.ndim != 1 or speeds.size < MIN_ROWS or len({speeds.shape, forces.shape, masses.shape} - {()}) > 1:
        shapes = speeds.shape, forces.shape, masses.shape
        raise ValueError(f"`{'`, `'.join(given)}` must be columns of one length >= {MIN_ROWS}, got shapes {shapes}")
    require_finite(speeds=speeds, forces=forces, added_masses=masses)
    require_nonnegative(relaxation_time=relaxation_time)
    if not (speeds[0] > 0 and np.all(np.diff(speeds) > 0)):
        raise ValueError(f"`speeds` must ascend from a value above 0, got {speeds.tolist()}")
    error = float(_cross_validation_errors(speeds, forces).max()) if speeds.size > MIN_ROWS else np.nan
    return ResistanceMap(speeds, forces, error, None, None if added_masses is None else masses, relaxation_time)


def sample_resistance(
    resistance: Callable[[float], tuple[float, float | None]],
    slowest: float,
    fastest: float,
    tolerance: float,
    known: Iterable[tuple[float, float, float | None]] = (),
) -> ResistanceMap:
    """Sample a resistance over a range of speeds until each sample is predicted by the others.

    Parameters
    ----------
    resistance : callable
        Force [N] and its relative error estimate [-], or None, at a speed [m/s].
    slowest, fastest : float
        Range of speeds [m/s], > 0.
    tolerance : float
        Largest cross-validation error over the largest force [-], > 0.
    known : iterable of (float, float, float or None)
        Speed, force and error of samples that exist already.

    Raises
    ------
    RuntimeError
        If `MAX_SAMPLES` samples do not suffice.
    """
    require_positive(slowest=slowest, fastest=fastest, tolerance=tolerance)
    samples = {speed: (force, error) for speed, force, error in known if speed <= fastest}
    initial = len(samples) < MIN_SAMPLES - 1
    required = np.geomspace(slowest, fastest, MIN_SAMPLES).tolist() if initial else [fastest]
    while len(samples) < MAX_SAMPLES:
        for speed in required:
            if speed not in samples:
                samples[speed] = resistance(speed)
        speeds = np.array(sorted(samples))
        forces = np.array([samples[speed][0] for speed in speeds])
        require_finite(resistance=forces)
        errors = _cross_validation_errors(speeds, forces)
        inaccurate, between = errors > tolerance, np.sqrt(speeds[:-1] * speeds[1:])
        required = between[inaccurate[:-1] | inaccurate[1:]].tolist()
        if inaccurate[0] and speeds[0] > MIN_SPEED_RATIO * fastest:
            required.append(float(speeds[0] / SPEED_REDUCTION))
        if not required:
            estimates = [error for _, error in samples.values() if error is not None]
            return ResistanceMap(speeds, forces, float(errors.max()), max(estimates, default=None))
    raise RuntimeError(
        f"{len(samples)} speeds from {speeds[0]:.3g} to {speeds[-1]:.3g} m/s have a cross-validation error of "
        f"{errors.max():.2g} of the largest force, tolerance {tolerance:g}; the error of the engine may exceed the "
        "tolerance, so raise the tolerance or refine the engine"
    )


def _cross_validation_errors(speeds: Array, forces: Array) -> Array:
    """Error of each sample predicted by the others, over the largest force; 0 for the fastest."""
    errors = np.zeros(len(speeds))
    for k in range(len(speeds) - 1):
        others, rest = np.delete(speeds, k), np.delete(forces, k)
        if k:
            predicted = _monotone_spline(others, rest)(np.log(speeds[k]))
        else:
            predicted = rest[0] * (speeds[0] / others[0]) ** _power_law_exponent(others, rest)
        errors[k] = abs(predicted - forces[k])
    return errors / max(np.abs(forces).max(), np.finfo(float).tiny)


def _monotone_spline(speeds: Array, values: Array) -> CubicHermiteSpline:
    """Cubic spline over ln v with slopes limited by Fritsch and Carlson where the samples are monotone.

    Slopes next to a local extremum of the samples are not limited, since the extremum may lie between samples.
    """
    x = np.log(speeds)
    secants = np.diff(values) / np.diff(x)
    signs = np.sign(np.concatenate([secants[:1], secants, secants[-1:]]))
    before, here, after = signs[:-2], signs[1:-1], signs[2:]
    monotone = (before * here >= 0) & (here * after >= 0) & (before * after >= 0)
    low = np.where(monotone, np.minimum(3 * secants, 0), -np.inf)
    high = np.where(monotone, np.maximum(3 * secants, 0), np.inf)
    slopes = CubicSpline(x, values)(x, 1)
    slopes = np.clip(slopes, np.append(low, -np.inf), np.append(high, np.inf))
    slopes = np.clip(slopes, np.insert(low, 0, -np.inf), np.insert(high, 0, np.inf))
    return CubicHermiteSpline(x, values, slopes)


def _power_law_exponent(speeds: Array, forces: Array) -> float:
    """Slope of ln F over ln v between the two slowest samples, within [0, 1]; 0 where the force changes its sign."""
    if forces[0] * forces[1] <= 0:
        return 0.0
    return float(np.clip(np.log(forces[1] / forces[0]) / np.log(speeds[1] / speeds[0]), 0.0, 1.0))
