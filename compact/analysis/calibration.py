"""Calibration of a scene: the two numbers of a compacting mix that no table knows, from what its plant has measured.

K_H sets the scale of all pressures and so the load, the fed density how far the mix is pressed and so the resistance.
Every trial is a whole contact of the scene that leaves the product at its height and density. The columns are the cheap
model; for the finite elements they are corrected until both agree (`fitting`), and the bounds of data and assumptions
are refitted with that correction. The finite elements begin shallow and on a coarse mesh, whose fit begins that on the
mesh asked for. Each trial is rolled from rest, so that the scene alone gives its numbers again.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from compact.analysis.contact_cases import contact_inputs, scene_mix
from compact.analysis.contact_stage import roll_scene
from compact.material import mix
from compact.numerics.space_mapping import SpaceMappingFit, fit_parameters
from compact.scene.loader import SceneError

UNKNOWNS = ("heckel_slope", "fed_density_ratio")
SHAKEN = 2e-3  # change of the unknowns that teaches half of a slope; what is solved at once does not tremble
LOOSE = mix.LOOSE_DENSITY_RATIO
SPREADS = ("friction_angle", "cohesion", "unloading_modulus", "poisson")  # of the mix, that decide beside the two
SHALLOW = 0.17  # capture angle, or less, at which finite elements begin
PLANE = 2.8  # times the load of columns, about, that they ask there
COARSE = 4  # increments of the first fit
STEADY = 1e-3  # of the two forces, where finite elements must march
SHEARED = ("mix.overrides.friction_angle", "mix.overrides.cohesion")  # what a bow wave feels and columns hardly do
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
    fit : in (ln K_H, logit of k), with misfit, sensitivity and what each run of the finite elements said
    rolled : the contact of each measurement by the engine
    refits : at every bound of data and assumptions
    elements : the finite elements, whose exit densities a neighbour knows; None of columns
    coarse : the `Calibration` on COARSE increments that finite elements began from, if any
    """

    scene: object
    heckel_slope: float
    fed_density_ratio: float
    unknowns: tuple[str, ...]
    names: tuple[str, ...]
    measured: tuple[float, ...]
    fit: SpaceMappingFit
    rolled: tuple
    refits: tuple[Refit, ...]
    elements: object = None
    coarse: object = None

    @property
    def sensitivity(self):
        """Relative change of each unknown by that of each datum, shape (unknowns, data)."""
        k, asked = self.fed_density_ratio, self.scene.mix.density_ratio
        by_logit = (k - LOOSE) * (asked - k) / (asked - LOOSE) / k  # d ln k/d logit
        scales = {"heckel_slope": 1.0, "fed_density_ratio": by_logit}
        return self.fit.sensitivity * np.array([[scales[name]] for name in self.unknowns])


def calibrate(scene, measured, engine="column", unknowns=UNKNOWNS, near=None, **options):
    """The `Calibration` of a scene to a `Measured`.

    engine : "column" or "compaction", of every trial;  unknowns : of UNKNOWNS, at most as many as there are data
    near : `Calibration` of a neighbour by finite elements, with another mix, mesh or data, where this one begins
    options : of the engine "compaction", such as `increments`; without `near` as few as COARSE are fitted before more

    Finite elements take minutes and meet the data to 1e-3; what their mesh does is told by the coarse fit. Refits are
    by columns as corrected, without what only two dimensions feel: fit again where a roller length changes how much
    cohesion weighs beside the pressure.

    Raises SceneError for more unknowns than data, assumptions that name no number of a scene, or a scene that says
    itself what presses the roller; RuntimeError where no trial meets the data.
    """
    _refuse_prescribed(scene)
    _refuse_far(near, measured, unknowns)
    model = _Model(scene, measured, unknowns)
    coarse = None
    if engine == "compaction" and near is None and options.get("increments") != COARSE:
        near = coarse = calibrate(scene, measured, engine, unknowns, **options | {"increments": COARSE})
    dear = _FiniteElements(options, _known(near, measured)) if engine == "compaction" else None
    try:
        met = model.met() if dear is None else model.met_by(dear, None if near is None else near.fit)
    except ValueError as error:
        raise SceneError([str(error)]) from error
    found = model.scene_at(met.unknowns)
    readings = measured.measurements
    return Calibration(
        scene=found,
        heckel_slope=scene_mix(found).heckel_slope,
        fed_density_ratio=found.layer.fed_density_ratio,
        unknowns=tuple(unknowns),
        names=model.names,
        measured=tuple(band.value for band in model.bands),
        fit=met,
        rolled=tuple(dear.rolled[reading] if dear else _column(found, reading) for reading in readings),
        refits=tuple(model.refits(met)),
        elements=dear,
        coarse=coarse,
    )


def _known(near, measured):
    """By how much the finite elements of a neighbour leave each measurement denser than columns."""
    return {} if near is None else dict(zip(measured.measurements, near.elements.excess.values(), strict=True))


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
        known = {"heckel_slope": np.log(scene_mix(self.scene).heckel_slope), "fed_density_ratio": float(logit)}
        return np.array([known[name] for name in self.unknowns])

    @property
    def shallow(self):
        """The start, with the mix fed as dense as a small capture angle asks, and about as soft as the load does."""
        asked, machine = self.scene.mix.density_ratio, self.scene.machine
        pressed = SHALLOW**2 * machine.roller_radius / (2 * self.scene.lift_thickness)
        share = (asked * (1 - pressed) - LOOSE) / (asked - LOOSE)
        start, places = self.start, dict(zip(self.unknowns, range(len(self.unknowns)), strict=True))
        if "fed_density_ratio" in places:
            i = places["fed_density_ratio"]
            start[i] = max(start[i], np.log(share / (1 - share)))
        if "heckel_slope" in places and "load" in self.names:
            i = self.names.index("load")
            start[places["heckel_slope"]] += np.log(PLANE * self.predicted(start, _column)[i] / self.bands[i].value)
        return start

    def scene_at(self, u):
        """The scene with the unknowns u in it."""
        changes, asked = {}, self.scene.mix.density_ratio
        for name, value in zip(self.unknowns, u, strict=True):
            if name == "heckel_slope":
                changes["mix.overrides.heckel_slope"] = float(np.exp(value))
                changes["unusual"] = (*self.scene.unusual, "mix.overrides.heckel_slope")  # trials may go anywhere
            else:
                changes["layer.fed_density_ratio"] = float(LOOSE + (asked - LOOSE) / (1 + np.exp(-value)))
        return self.scene.replaced(**changes)

    def predicted(self, u, contact):
        """The data as `contact` predicts them, of a scene and a measurement, for the unknowns u."""
        trial, length, values = self.scene_at(u), self.scene.machine.roller_length, []
        for measurement in self.measured.measurements:
            rolled = contact(trial, measurement)
            known = {
                "load": rolled.load * length,
                "resistance": abs(rolled.resistance) * length,
                "resistance_coefficient": abs(rolled.resistance) / rolled.load,
            }
            values += [known[name] for name, _ in measurement.data]
        return np.array(values)

    def met(self, values=None, correction=None):
        """The `SpaceMappingFit` of columns, as corrected, to the data or to other values."""
        values = [band.value for band in self.bands] if values is None else values
        return fit_parameters(lambda u: self.predicted(u, _column), values, self.start, correction=correction)

    def met_by(self, dear, near=None):
        """The `SpaceMappingFit` of finite elements to the data, from a `SpaceMappingFit` near by where there is one."""
        start, correction = (self.shallow, None) if near is None else (near.unknowns, near.correction)
        return fit_parameters(
            lambda u: self.predicted(u, _column),
            [band.value for band in self.bands],
            start,
            lambda u: self.predicted(u, dear),
            correction=correction,
            broyden_length=SHAKEN,
        )

    def refits(self, met):
        """The unknowns at every bound, with the correction of the columns kept."""
        values = [band.value for band in self.bands]
        for i, (name, band) in enumerate(zip(self.names, self.bands, strict=True)):
            for bound in {band.low, band.high} - {band.value}:
                moved = [*values[:i], bound, *values[i + 1 :]]
                yield self._refit(name, bound, self, moved, met.correction)
        for key, bounds in self._assumptions().items():
            for bound in bounds:
                if met.history and key in SHEARED:
                    yield Refit(key, bound, reason=f"columns do not feel it; calibrate with --set {key}={bound:g}")
                    continue
                model = _Model(self.scene.replaced(**{key: bound}), self.measured, self.unknowns)
                yield self._refit(key, bound, model, values, met.correction)

    def _assumptions(self):
        """(low, high) by key: those stated with the data, and the prior's spreads of what is not overridden."""
        parameters = {f"mix.overrides.{name}": scene_mix(self.scene).parameter(name) for name in SPREADS}
        spreads = {key: (p.low, p.high) for key, p in parameters.items() if p.low < p.high}
        return spreads | self.measured.assumptions

    @staticmethod
    def _refit(name, bound, model, values, correction):
        try:
            met = model.met(values, correction)
        except (RuntimeError, ValueError) as error:
            return Refit(name, bound, reason=str(error))
        found = model.scene_at(met.unknowns)
        return Refit(name, bound, scene_mix(found).heckel_slope, found.layer.fed_density_ratio)


def _as_measured(scene, measurement):
    """Scene and speed of a measurement."""
    if measurement.exit_density_ratio is not None:
        scene = scene.replaced(**{"mix.density_ratio": measurement.exit_density_ratio})
    return scene, measurement.speed or scene.mean_speed


def _column(scene, measurement):
    """One contact of a scene as it was measured."""
    scene, speed = _as_measured(scene, measurement)
    return roll_scene(scene, scene_mix(scene), speed, "column")


@dataclass(eq=False)
class _FiniteElements:
    """Contacts of one trial after the other by finite elements, each from rest.

    The depth is that of the columns, for a density by as much off as the trial before has missed it.

    options : of `compaction.roll`
    excess : by measurement, of the last exit density over that of its columns;  rolled : the last contact
    """

    options: dict
    excess: dict
    rolled: dict = field(default_factory=dict)

    def __call__(self, scene, measurement):
        from compact.engines.column.engine import required_feed
        from compact.engines.compaction import engine as compaction

        scene, speed = _as_measured(scene, measurement)
        layer, roller, material = contact_inputs(scene, scene_mix(scene), "compaction", speed)
        asked = scene.mix.density_ratio - self.excess.get(measurement, 0.0)
        fed = required_feed(layer.height, asked, material, speed)
        roller = replace(roller, indentation=layer.height * fed.indentation / fed.height)
        there = compaction.roll(layer, roller, material, speed, **{"steady_tolerance": STEADY} | self.options)
        self.excess[measurement], self.rolled[measurement] = there.exit_density_ratio - asked, there
        return there


def _refuse_far(near, measured, unknowns):
    if near is None:
        return
    if near.elements is None:
        raise ValueError("`near` must be a calibration of finite elements, got one of columns")
    if near.unknowns != tuple(unknowns):
        raise ValueError(f"`near` must have fitted {', '.join(unknowns)}, got {', '.join(near.unknowns)}")
    if len(near.rolled) != len(measured.measurements):
        raise ValueError(f"`near` must have {len(measured.measurements)} measurements, got {len(near.rolled)}")


def _refuse_prescribed(scene):
    if given := scene.target:
        raise SceneError(
            [f"contact.{name}: a calibration presses the product to its density; take {value:g} out of the scene"
             for name, value in given.items()]
        )  # fmt: skip


def digest(calibration):
    """What a person wants to read: the fit, what moves it, what stays uncertain."""
    slope, fed = calibration.heckel_slope, calibration.fed_density_ratio
    lines = ["measured"]
    for name, value, off in zip(calibration.names, calibration.measured, calibration.fit.misfit, strict=True):
        lines.append(f"  {name:<24}{value:>12.6g}  met to {abs(np.expm1(off)):.1e}")
    runs = len(calibration.fit.history)
    if runs:
        ratios, scatter = np.exp(calibration.fit.correction.ratio), calibration.fit.scatter
        lines.append(f"by {runs} runs of finite elements; over columns, and how far the last ones were off")
        for name, ratio, off in zip(calibration.names, ratios, scatter, strict=True):
            lines.append(f"  {name:<24}{ratio:>12.4f}  {off:.1e}")
    if calibration.coarse:
        there = calibration.coarse
        found = f"K_H {there.heckel_slope * 1e6:.4f} /MPa, fed {there.fed_density_ratio:.5f}"
        lines.append(f"on {COARSE} increments {found}")
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
        "runs": [{"unknowns": u, "misfit": misfit} for u, misfit in calibration.fit.history],
        "refits": [vars(refit) for refit in calibration.refits],
    }
