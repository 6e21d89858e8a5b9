"""How the resistance follows a speed that changes slowly, at first order in the acceleration.

    F(v, a) ~ F_ss(v) + a M(v)

The surface of a viscoelastic layer still remembers a lower speed under a roller that gathers speed: M is an added mass,
of no matter but of memory. At low speeds it is negative, a pure lag; at high ones it fades.

    v -> 0     M -> -t dF_ss/dv,  t = sum share time^2/sum share time
    v -> inf   M ~ 1/v^3

The lag is that of gaps measured vertically; normal to the circle on the deformed surface it is longer by about the
indentation over the radius. F_ss is odd in v, M even. What the roller prescribes, be it indentation, load or peak
pressure, is kept at every instant of the motion as F_ss(v) keeps it over v. Inertia of layer and roller is not in it.

Layers of columns, engine "column", remember the way, not the time: at a given indentation the density under the roller
is a matter of geometry and the yield limit one of the speed now, so that M = 0 exactly. The same holds for the engine
"compaction" where the mix knows no rate.

What the mix resists at any speed: an engine sampled over the speeds of a motion until it predicts itself.

    F(v, a) = F(v) + a' M(v),    a' = a while |a| <= A, else A sign(a),    A = UNSTEADINESS_LIMIT |v|/tau

F and M over ln |v| by cubics, F monotone where the samples are; F is odd in v, M even. If the return stroke, v < 0,
rolls over compacted mix, both are smaller there by a constant ratio. Below the slowest sample F
follows the power law v^n that it has there, 0 <= n <= 1: n = 1 for a layer that relaxes, 0 for one that resists at any
speed alike; M stays as it is. The map tells its own error: each sample is predicted by the others, and where that
fails new ones are put on both sides of it. At rest the resistance is set-valued; the call returns the middle, 0.

First order in the acceleration holds while |a| tau/|v| is below UNSTEADINESS_LIMIT (`modulation`), so never at a turn; `beyond` says
where. There the second term is held at what it is at the limit: continuous, and gone at rest. That repairs little: on a
Winkler foundation (operating point's contact, Eg/Er 1.5, tau 0.1 s, four laws) the largest miss of a pass of 3 s is
0.16-0.41 of the peak force without M, 0.14-0.39 with it; in 0.6 s, where most is beyond, both miss 0.8-1.6. M without a
limit misses half as much by root mean square in 3 s, and 1.4-50 peak forces in 0.6 s. Beside a turn, and for a few tau
after the acceleration jumps, history decides, of which |a| tau/|v| knows nothing.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from compact.numerics.validation import require_finite, require_positive

UNSTEADINESS_LIMIT = 0.1  # unsteadiness at which the first order leaves out 0.4 % of F on a Winkler foundation, or less


@dataclass(frozen=True)
class ResistanceExpansion:
    """Resistance of one roller near a steady speed, per unit roller length.

    speed : v [m/s]
    resistance : F_ss [N/m]
    slope : dF_ss/dv [N s/m2]
    added_mass : M [N s2/m2]
    error : estimated, of `added_mass` [N s2/m2], or None where the engine cannot tell; not relative, as M passes zero
    time : tau, the longest relaxation time [s], 0 of an elastic layer
    """

    speed: float
    resistance: float
    slope: float
    added_mass: float
    error: float | None
    relaxation_time: float

    def unsteadiness(self, acceleration):
        """|a| tau/|v| [-] at accelerations a [m/s2]: use F_ss + a M below `UNSTEADINESS_LIMIT`; at 1 and above it is void.

        A contact that is short, 2b/v < tau with b its half-width, forgets sooner: then |a| 2b/v^2 << 1 is enough.

        >>> found = ResistanceExpansion(0.5, 100.0, 20.0, -3.0, error=0.0, relaxation_time=0.1)
        >>> f"{found.unsteadiness(-0.25):.2f}"
        '0.05'
        """
        require_finite(acceleration=acceleration)
        return np.abs(acceleration) * self.relaxation_time / abs(self.speed)


FEWEST = 5  # samples to begin with
MAX_SAMPLES = 64
BLOCK = 8192  # speeds at a time, which stay in the processor's cache
SLOWEST = 1e-6  # of the fastest: where nothing still changes by the tolerance
SLOWER = 4.0  # times, each step down while the power law does not hold
SPEED_ROUNDING = 1e-9  # by which a speed may pass the fastest sample
VERSIONED = ("compact", "numpy", "scipy")


@dataclass(frozen=True, eq=False)
class ResistanceMap:
    """A resistance over speed and acceleration; call it with velocities [m/s] and accelerations [m/s2].

    speeds, forces : the samples [m/s], [N], rising speeds > 0, shape (n,)
    error : largest miss of a sample predicted by the others, over the largest force
    engine_error : largest relative error that the engine told of a sample, or None
    added_masses : M at the speeds [kg], shape (n,), or None where it is not known and left out
    time : tau, the longest relaxation time [s], 0 of a mix that forgets at once
    return_ratio : resistance of the return stroke, v < 0, over that of the way out [-]
    """

    speeds: np.ndarray
    forces: np.ndarray
    error: float
    engine_error: float | None = None
    added_masses: np.ndarray | None = None
    relaxation_time: float = 0.0
    return_ratio: float = 1.0

    odd = True  # with either sign: a driven roller pulls its cart

    def __call__(self, velocity, acceleration=0.0):
        """F [N], of the common shape of velocity and acceleration.

        Raises ValueError beyond the fastest sample.
        """
        self._refuse_faster(np.abs(velocity))
        kinds = [["readonly"], ["readonly"], ["writeonly", "allocate"]]
        blocks = np.nditer(
            [np.asarray(velocity, float), np.asarray(acceleration, float), None],
            ["external_loop", "buffered", "zerosize_ok"], kinds, order="C", buffersize=BLOCK,
        )  # fmt: skip
        with blocks:
            for some_velocity, some_acceleration, force in blocks:
                force[...] = self._at(some_velocity, some_acceleration)
            return blocks.operands[2][()]

    def _at(self, velocity, acceleration):
        slowest, speed = self.speeds[0], np.abs(velocity)
        sample_resistance = self._cubics(np.log(np.clip(speed, slowest, self.speeds[-1])))
        force = sample_resistance[:, 0]
        if self.exponent and np.min(speed) < slowest:
            force = force * np.minimum(speed / slowest, 1.0) ** self.exponent
        force = np.sign(velocity) * force
        if self.added_masses is not None:
            if self.relaxation_time:
                most = self.rate_limit * speed
                acceleration = np.clip(acceleration, -most, most)
            force = force + acceleration * sample_resistance[:, 1]
        return force if self.return_ratio == 1 else np.where(velocity < 0, self.return_ratio, 1.0) * force

    @property
    def rate_limit(self):
        """A/|v| [1/s], up to which the second term follows the acceleration; infinite where nothing is remembered."""
        return UNSTEADINESS_LIMIT / self.relaxation_time if self.relaxation_time else np.inf

    def unsteadiness(self, velocity, acceleration):
        """|a| tau/|v| [-]; infinite at a turn, 0 where the cart stands."""
        hurry = self.relaxation_time * np.abs(np.asarray(acceleration, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(hurry > 0, hurry / np.abs(velocity), 0.0)[()]

    def is_unsteady(self, velocity, acceleration):
        """Whether a motion is too unsteady there for first order in its acceleration."""
        return self.unsteadiness(velocity, acceleration) >= UNSTEADINESS_LIMIT

    @cached_property
    def _cubics(self):
        """F, and M where it is known, over ln v."""
        columns = [self.forces] if self.added_masses is None else [self.forces, self.added_masses]
        fitted = [cubics(self.speeds, values) for values in columns]
        return PPoly(np.stack([each.c for each in fitted], axis=-1), fitted[0].x)

    @cached_property
    def exponent(self):
        """n of the power law below the slowest sample."""
        return _exponent(self.speeds, self.forces)

    def _refuse_faster(self, speed):
        if np.max(speed, initial=0.0) > self.speeds[-1] * (1 + SPEED_ROUNDING):
            raise ValueError(
                f"the resistance was computed up to {self.speeds[-1]:g} m/s, got {np.max(speed):g} m/s; "
                "sample it over the speeds of the motion"
            )

    def scaled(self, share):
        """The map of a resistance that is so many times as large."""
        masses = None if self.added_masses is None else share * self.added_masses
        return replace(self, forces=share * self.forces, added_masses=masses)

    def save(self, path, key=""):
        """Write the map as netCDF, with the key of all it depends on and the versions that made it; whole or not."""
        import xarray

        from compact.files import NETCDF_CLASSIC, write_netcdf

        variables = {"speed": (self.speeds, "m/s"), "resistance": (self.forces, "N")}
        if self.added_masses is not None:
            variables["added_mass"] = (self.added_masses, "kg")
        columns = {
            name: ("speed", values, {"units": unit}, {"_FillValue": None}) for name, (values, unit) in variables.items()
        }
        attributes = {
            "key": key,
            "versions": _versions(),
            "error": float(self.error),
            "relaxation_time": float(self.relaxation_time),
            "return_ratio": float(self.return_ratio),
            "engine_error": float(np.nan if self.engine_error is None else self.engine_error),
        }
        write_netcdf(path, xarray.Dataset(columns, attrs=attributes), NETCDF_CLASSIC)


def load_resistance_map(path, key=""):
    """The `ResistanceMap` of a file; ValueError where it has another key, is of other versions, or is no such file."""
    from compact.files import NETCDF_CLASSIC, read_netcdf

    try:
        table = read_netcdf(path, NETCDF_CLASSIC)
        made = table.attrs["key"], table.attrs["versions"]
        error, told, time, ratio = (
            float(table.attrs[name]) for name in ("error", "engine_error", "relaxation_time", "return_ratio")
        )
        columns = {name: np.array(variable, dtype=float) for name, variable in table.variables.items()}
        speeds, forces = columns["speed"], columns["resistance"]
    except (LookupError, TypeError) as wrong:
        reason = str(wrong).partition("\n")[0]
        raise ValueError(f"{path}: no resistance map: {reason}; compute it again") from None
    if made != (key, _versions()):
        raise ValueError(
            f"{path}: made under key {made[0] or 'none'} by {made[1]}, wanted {key or 'none'} and {_versions()}; "
            "compute it again"
        )
    engine_error = None if np.isnan(told) else told
    return ResistanceMap(speeds, forces, error, engine_error, columns.get("added_mass"), time, ratio)


def _versions():
    return ", ".join(f"{name} {version(name)}" for name in VERSIONED)


def sample_resistance(resistance, slowest, fastest, tolerance, known=()):
    """The `ResistanceMap` from a slowest to a fastest speed [m/s] of resistance(speed) -> (force [N], relative error).

    known : (speed, force, error) that are there already; an error may be None
    tolerance : of the largest force, by which a sample may be missed by the others

    Raises RuntimeError where so many samples as `MAX_SAMPLES` do not suffice.
    """
    require_positive(slowest=slowest, fastest=fastest, tolerance=tolerance)
    samples = {speed: (force, error) for speed, force, error in known if speed <= fastest}
    wanted = [fastest] if len(samples) >= FEWEST - 1 else np.geomspace(slowest, fastest, FEWEST).tolist()
    while len(samples) < MAX_SAMPLES:
        for speed in wanted:
            if speed not in samples:
                samples[speed] = resistance(speed)
        speeds = np.array(sorted(samples))
        forces = np.array([samples[speed][0] for speed in speeds])
        require_finite(resistance=forces)
        misses = _misses(speeds, forces)
        wanted = _wanted(speeds, misses > tolerance, SLOWEST * fastest)
        if not wanted:
            told = [error for _, error in samples.values() if error is not None]
            return ResistanceMap(speeds, forces, float(misses.max()), max(told, default=None))
    raise RuntimeError(
        f"{len(samples)} speeds from {speeds[0]:.3g} to {speeds[-1]:.3g} m/s predict each other to {misses.max():.2g} "
        f"of the largest force only, {tolerance:g} was asked; the engine's own error may be larger than that"
    )


def _misses(speeds, forces):
    """How far each sample lies from what the others predict, over the largest force; the fastest is not predicted."""
    misses = np.zeros(len(speeds))
    for k in range(len(speeds) - 1):
        others, rest = np.delete(speeds, k), np.delete(forces, k)
        if k:
            predicted = cubics(others, rest)(np.log(speeds[k]))
        else:
            predicted = rest[0] * (speeds[0] / others[0]) ** _exponent(others, rest)
        misses[k] = abs(predicted - forces[k])
    return misses / max(np.abs(forces).max(), np.finfo(float).tiny)


def _wanted(speeds, missed, slowest):
    """Speeds between each sample that is missed and its neighbours; below the slowest a slower one."""
    between = np.sqrt(speeds[:-1] * speeds[1:])
    wanted = between[missed[:-1] | missed[1:]].tolist()
    return [float(speeds[0] / SLOWER), *wanted] if missed[0] and speeds[0] > slowest else wanted


def cubics(speeds, forces):
    """The cubic spline over ln v; where samples rise or fall on and on, slopes are cut so that it does too (Fritsch and
    Carlson). Beside a sample where they turn the top may lie between samples, and nothing is cut."""
    x = np.log(speeds)
    rises = np.diff(forces) / np.diff(x)
    ways = np.sign(np.concatenate([rises[:1], rises, rises[-1:]]))
    before, here, after = ways[:-2], ways[1:-1], ways[2:]
    same = (before * here >= 0) & (here * after >= 0) & (before * after >= 0)
    low, high = np.where(same, np.minimum(3 * rises, 0), -np.inf), np.where(same, np.maximum(3 * rises, 0), np.inf)
    slopes = CubicSpline(x, forces)(x, 1)
    slopes = np.clip(slopes, np.append(low, -np.inf), np.append(high, np.inf))
    slopes = np.clip(slopes, np.insert(low, 0, -np.inf), np.insert(high, 0, np.inf))
    return CubicHermiteSpline(x, forces, slopes)


def _exponent(speeds, forces):
    """Slope of ln F over ln v at the slowest sample, by the next; 0 where the force changes its sign."""
    if forces[0] * forces[1] <= 0:
        return 0.0
    return float(np.clip(np.log(forces[1] / forces[0]) / np.log(speeds[1] / speeds[0]), 0.0, 1.0))
