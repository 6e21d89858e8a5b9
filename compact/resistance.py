"""What the mix resists at any speed: an engine sampled over the speeds of a motion until it predicts itself.

    F(v) = sign(v) F(|v|),    F over ln v by cubics, monotone where the samples are

Below the slowest sample F follows the power law v^n that it has there, 0 <= n <= 1: n = 1 for a layer that relaxes, 0
for one that resists at any speed alike. The map tells its own error: each sample is predicted by the others, and where
that fails new ones are put on both sides of it. At rest the resistance is set-valued; the call returns the middle, 0.
"""

from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from io import BytesIO

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from compact.refuse import refuse_nonfinite, refuse_nonpositive

FEWEST = 5  # samples to begin with
MOST = 64
SLOWEST = 1e-6  # of the fastest: where nothing still changes by the tolerance
SLOWER = 4.0  # times, each step down while the power law does not hold
ROUNDING = 1e-9  # by which a speed may pass the fastest sample
VERSIONED = ("compact", "numpy", "scipy")


@dataclass(frozen=True, eq=False)
class ResistanceMap:
    """A resistance over speed; call it with velocities [m/s] and accelerations [m/s2].

    speeds, forces : the samples [m/s], [N], rising speeds > 0, shape (n,)
    error : largest miss of a sample predicted by the others, over the largest force
    engine_error : largest relative error that the engine told of a sample, or None
    """

    speeds: np.ndarray
    forces: np.ndarray
    error: float
    engine_error: float | None = None

    def __call__(self, velocity, acceleration=0.0):
        """F [N], of the common shape of velocity and acceleration, which it does not depend on.

        Raises ValueError beyond the fastest sample.
        """
        velocity = np.asarray(velocity, dtype=float)
        speed = np.abs(velocity)
        self._refuse_faster(speed)
        force = np.copysign(1.0, velocity) * self._at(speed)
        return np.broadcast_to(force, np.broadcast_shapes(force.shape, np.shape(acceleration)))[()]

    def _at(self, speed):
        slowest, fastest = self.speeds[[0, -1]]
        force = self._cubics(np.log(np.clip(speed, slowest, fastest)))
        if np.min(speed, initial=np.inf) < slowest:
            with np.errstate(divide="ignore"):
                force = np.where(speed < slowest, force * (speed / slowest) ** self.exponent, force)
        return np.where(speed > 0, force, 0.0)

    @cached_property
    def _cubics(self):
        return cubics(self.speeds, self.forces)

    @cached_property
    def exponent(self):
        """n of the power law below the slowest sample."""
        return _exponent(self.speeds, self.forces)

    @property
    def limit(self):
        """What it resists before it moves [N]: 0 where the resistance vanishes with the speed."""
        return float(abs(self.forces[0])) if self.exponent == 0 else 0.0

    def _refuse_faster(self, speed):
        if np.max(speed, initial=0.0) > self.speeds[-1] * (1 + ROUNDING):
            raise ValueError(
                f"the resistance was computed up to {self.speeds[-1]:g} m/s, got {np.max(speed):g} m/s; "
                "sample it over the speeds of the motion"
            )

    def save(self, path, scene_hash=""):
        """Write the map as netCDF, with the fingerprint of its scene and the versions that made it; whole or not."""
        from scipy.io import netcdf_file

        from compact.results import whole_file

        held = BytesIO()
        with netcdf_file(held, "w") as content:
            content.createDimension("speed", len(self.speeds))
            for name, values, unit in (("speed", self.speeds, "m/s"), ("resistance", self.forces, "N")):
                variable = content.createVariable(name, "d", ("speed",))
                variable[:], variable.units = values, unit
            content.scene_hash, content.versions = scene_hash, _versions()
            content.error = np.float64(self.error)
            content.engine_error = np.float64(np.nan if self.engine_error is None else self.engine_error)
            content.flush()
            written = held.getvalue()
        with whole_file(path, "wb") as stream:
            stream.write(written)


def load(path, scene_hash=""):
    """The `ResistanceMap` of a file; ValueError where it is of another scene or of other versions."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "r", mmap=False) as content:
        of_scene, of_versions = content.scene_hash.decode(), content.versions.decode()
        if (of_scene, of_versions) != (scene_hash, _versions()):
            raise ValueError(
                f"{path}: made of scene {of_scene or 'unknown'} by {of_versions}, wanted {scene_hash or 'unknown'} "
                f"and {_versions()}; compute it again"
            )
        told = float(content.engine_error)
        speeds, forces = (np.array(content.variables[name][:], dtype=float) for name in ("speed", "resistance"))
        return ResistanceMap(speeds, forces, float(content.error), None if np.isnan(told) else told)


def _versions():
    return ", ".join(f"{name} {version(name)}" for name in VERSIONED)


def sampled(resistance, slowest, fastest, tolerance, known=()):
    """The `ResistanceMap` from a slowest to a fastest speed [m/s] of resistance(speed) -> (force [N], relative error).

    known : (speed, force, error) that are there already; an error may be None
    tolerance : of the largest force, by which a sample may be missed by the others

    Raises RuntimeError where so many samples as `MOST` do not suffice.
    """
    refuse_nonpositive(slowest=slowest, fastest=fastest, tolerance=tolerance)
    samples = {speed: (force, error) for speed, force, error in known if speed <= fastest}
    wanted = [fastest] if len(samples) >= FEWEST - 1 else np.geomspace(slowest, fastest, FEWEST).tolist()
    while len(samples) < MOST:
        for speed in wanted:
            if speed not in samples:
                samples[speed] = resistance(speed)
        speeds = np.array(sorted(samples))
        forces = np.array([samples[speed][0] for speed in speeds])
        refuse_nonfinite(resistance=forces)
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
