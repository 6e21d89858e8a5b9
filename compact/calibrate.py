"""Calibration of a scene: the two numbers of a compacting mix that no table knows, from what its plant has measured.

K_H sets the scale of all pressures and so the load, the fed density how far the mix is pressed and so the resistance.
Every trial is a whole contact of the scene that leaves the product at its height and density. The columns are the cheap
model; for the finite elements they are corrected until both agree (`fitting`), and the bounds of data and assumptions
are refitted with that correction.
"""

from dataclasses import dataclass

import numpy as np

from compact import mix
from compact.engine import roll
from compact.fitting import Fit, fit
from compact.scene import SceneError

UNKNOWNS = ("heckel_slope", "fed_density_ratio")
LOOSE = mix.LOOSE
SPREADS = ("friction_angle", "cohesion", "unloading_modulus", "poisson")  # of the mix, that decide beside the two
START = 0.4  # of the way from loose to the density asked for, over what is left: k 0.98 from about 0.94


@dataclass(frozen=True)
class Refit:
    """The unknowns where one number, of the data or assumed, stands at a bound; `reason` where none are found."""

    name: str
    value: float
    heckel_slope: float = np.nan
    fed_density_ratio: float = np.nan
    reason: str = ""


@dataclass(frozen=True)
class Calibration:
    """A scene's mix as calibrated.

    scene : with the fitted numbers in it
    heckel_slope : K_H, one-dimensional as in mix tables [1/Pa];  fed_density_ratio : k
    unknowns : names of those fitted;  names, measured : of the data
    fit : in (ln K_H, logit of k), with misfit and sensitivity
    rolled : the contact of each measurement by the scene's engine
    refits : at every bound of data and assumptions
    """

    scene: object
    heckel_slope: float
    fed_density_ratio: float
    unknowns: tuple[str, ...]
    names: tuple[str, ...]
    measured: tuple[float, ...]
    fit: Fit
    rolled: tuple
    refits: tuple[Refit, ...]

    @property
    def sensitivity(self):
        """Relative change of each unknown by that of each datum, shape (unknowns, data)."""
        k, asked = self.fed_density_ratio, self.scene.mix.density_ratio
        by_logit = (k - LOOSE) * (asked - k) / (asked - LOOSE) / k  # d ln k/d logit
        scales = {"heckel_slope": 1.0, "fed_density_ratio": by_logit}
        return self.fit.sensitivity * np.array([[scales[name]] for name in self.unknowns])


def calibrate(scene, measured, engine="column", unknowns=UNKNOWNS):
    """The `Calibration` of a scene to a `Measured`.

    engine : "column" or "compaction", of every trial;  unknowns : of UNKNOWNS, at most as many as there are data

    Raises SceneError for more unknowns than data, or assumptions that name no number of a scene; RuntimeError where
    no trial meets the data.
    """
    model = _Model(scene, measured, unknowns)
    try:
        met = model.met(engine)
    except ValueError as error:
        raise SceneError([str(error)]) from error
    found = model.scene_at(met.unknowns)
    return Calibration(
        scene=found,
        heckel_slope=blend(found).heckel_slope,
        fed_density_ratio=found.layer.fed_density_ratio,
        unknowns=tuple(unknowns),
        names=model.names,
        measured=tuple(band.value for band in model.bands),
        fit=met,
        rolled=tuple(_contact(found, measurement, engine) for measurement in measured.measurements),
        refits=tuple(model.refits(met)),
    )


def blend(scene):
    """The mix of a scene: prior and overrides."""
    return mix.prior(scene.mix.moisture, scene.mix.density_ratio, scene.mix.overrides.model_dump(exclude_none=True))


@dataclass(frozen=True)
class _Model:
    """What is predicted for a scene with two of its numbers unknown."""

    scene: object
    measured: object
    unknowns: tuple[str, ...]

    @property
    def _data(self):
        return [(m, name, band) for m in self.measured.measurements for name, band in m.data]

    @property
    def names(self):
        return tuple(name for _, name, _ in self._data)

    @property
    def bands(self):
        return tuple(band for _, _, band in self._data)

    @property
    def start(self):
        asked = self.scene.mix.density_ratio
        share = (self.scene.layer.fed_density_ratio - LOOSE) / (asked - LOOSE)
        logit = np.log(share / (1 - share)) if 0 < share < 1 else START
        known = {"heckel_slope": np.log(blend(self.scene).heckel_slope), "fed_density_ratio": float(logit)}
        return np.array([known[name] for name in self.unknowns])

    def scene_at(self, u):
        """The scene with the unknowns u in it."""
        changes, asked = {}, self.scene.mix.density_ratio
        for name, value in zip(self.unknowns, u, strict=True):
            if name == "heckel_slope":
                changes["mix.overrides.heckel_slope"] = float(np.exp(value))
            else:
                changes["layer.fed_density_ratio"] = float(LOOSE + (asked - LOOSE) / (1 + np.exp(-value)))
        return self.scene.replaced(**changes)

    def predicted(self, u, engine):
        """The data as an engine predicts them for the unknowns u."""
        trial, length, values = self.scene_at(u), self.scene.machine.roller_length, []
        for measurement in self.measured.measurements:
            rolled = _contact(trial, measurement, engine)
            known = {
                "load": rolled.load * length,
                "resistance": abs(rolled.resistance) * length,
                "resistance_coefficient": abs(rolled.resistance) / rolled.load,
            }
            values += [known[name] for name, _ in measurement.data]
        return np.array(values)

    def met(self, engine, values=None, correction=0.0):
        """The `Fit` to the data, or to other values."""
        values = [band.value for band in self.bands] if values is None else values
        dear = None if engine == "column" else lambda u: self.predicted(u, engine)
        return fit(lambda u: self.predicted(u, "column"), values, self.start, dear, correction=correction)

    def refits(self, met):
        """The unknowns at every bound, with the correction of the columns kept."""
        values = [band.value for band in self.bands]
        for i, (name, band) in enumerate(zip(self.names, self.bands, strict=True)):
            for bound in {band.low, band.high} - {band.value}:
                moved = [*values[:i], bound, *values[i + 1 :]]
                yield self._refit(name, bound, self, moved, met.correction)
        for key, bounds in self._assumptions().items():
            for bound in bounds:
                model = _Model(self.scene.replaced(**{key: bound}), self.measured, self.unknowns)
                yield self._refit(key, bound, model, values, met.correction)

    def _assumptions(self):
        """(low, high) by key: those stated with the data, and the prior's spreads of what is not overridden."""
        parameters = {f"mix.overrides.{name}": blend(self.scene).parameter(name) for name in SPREADS}
        spreads = {key: (p.low, p.high) for key, p in parameters.items() if p.low < p.high}
        return spreads | self.measured.assumptions

    @staticmethod
    def _refit(name, bound, model, values, correction):
        try:
            met = model.met("column", values, correction)
        except (RuntimeError, ValueError) as error:
            return Refit(name, bound, reason=str(error))
        found = model.scene_at(met.unknowns)
        return Refit(name, bound, blend(found).heckel_slope, found.layer.fed_density_ratio)


def _contact(scene, measurement, engine):
    """One contact of a scene as it was measured."""
    if measurement.exit_density_ratio is not None:
        scene = scene.replaced(**{"mix.density_ratio": measurement.exit_density_ratio})
    mean = scene.motion.stroke / scene.motion.duration
    return roll(scene, blend(scene), measurement.speed or mean, engine)


def digest(calibration):
    """What a person wants to read: the fit, what moves it, what stays uncertain."""
    slope, fed = calibration.heckel_slope, calibration.fed_density_ratio
    lines = ["measured"]
    for name, value, off in zip(calibration.names, calibration.measured, calibration.fit.misfit, strict=True):
        lines.append(f"  {name:<24}{value:>12.6g}  met to {abs(np.expm1(off)):.1e}")
    lines += ["calibrated", f"  {'heckel_slope':<24}{slope * 1e6:>12.4f} /MPa (one-dimensional)"]
    lines += [
        f"  {'fed_density_ratio':<24}{fed:>12.5f}",
        f"1 % more of the datum moves {' and '.join(calibration.unknowns)} by",
    ]
    for name, moves in zip(calibration.names, calibration.sensitivity.T, strict=True):
        lines.append(f"  {name:<24}" + ", ".join(f"{move:+.3f} %" for move in moves))
    lines.append(f"{'where instead':<36}{'is':>12}{'K_H, 1/MPa':>14}{'fed density':>14}")
    for refit in calibration.refits:
        found = f"{refit.heckel_slope * 1e6:>14.3f}{refit.fed_density_ratio:>14.4f}"
        lines.append(
            f"  {refit.name:<34}{refit.value:>12.5g}{found if not refit.reason else f'  none: {refit.reason}'}"
        )
    return "\n".join(lines)


def summary(calibration):
    """The same as plain numbers, for JSON; SI."""
    return {
        "scene_hash": calibration.scene.hash,
        "heckel_slope": calibration.heckel_slope,
        "fed_density_ratio": calibration.fed_density_ratio,
        "fitted": calibration.unknowns,
        "data": [
            {"name": name, "value": value, "misfit": misfit, "sensitivity": moves}
            for name, value, misfit, moves in zip(
                calibration.names, calibration.measured, calibration.fit.misfit, calibration.sensitivity.T, strict=True
            )
        ],
        "refits": [vars(refit) for refit in calibration.refits],
    }
