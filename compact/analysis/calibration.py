"""Calibration of a scene: Heckel slope and initial density ratio of the mix, and its drive, from measurements.

The Heckel slope K_H scales all pressures, and so the load; the initial density ratio determines the compaction, and so
the resistance. Every trial is a contact of the scene that results in the height and density of the product. The column
model is the coarse model of a space mapping (`numerics.space_mapping`) to the finite elements; the bounds of data and
assumptions are refitted with its correction. Finite elements start at a small contact angle on a coarse mesh, whose fit
is the initial guess on the required mesh. Each trial is computed from scratch, so that the scene reproduces its result.

The stiffness of the drive is the slope of force over deflection of the blocked cart, its damping that of a cart which
swings on its blocked drive:

    deflection = zero + force/k + sign(force) backlash/2,   k = m omega^2,   c = 2 zeta sqrt(k m)
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.special import expit, logit
from scipy.stats import t as student

from compact.analysis import machine_models
from compact.analysis.contact_cases import case_of, on_roller, roll_scene, scene_mix
from compact.analysis.failures import reason_of
from compact.engines.process.kneading import KneadingFit
from compact.machine.cart import balance
from compact.material import mix
from compact.numerics import Array
from compact.numerics.space_mapping import SpaceMappingFit, fit_parameters
from compact.rolling_contact import ContactResult
from compact.scene import constraints, plant_data, schema
from compact.scene.loader import Scene, SceneError

UNKNOWNS = ("heckel_slope", "fed_density_ratio")
CONFIDENCE = 0.95  # [-], of the ± of a stiffness and a damping, by Student's t
LOOSE = mix.LOOSE_DENSITY_RATIO
ASSUMED = ("friction_angle", "cohesion", "saturation_limit", "unloading_modulus", "poisson")  # of the mix, not fitted
START_ANGLE = 0.17  # [rad], largest contact angle of the first trial of the finite elements
PLANE_STRAIN_FACTOR = 2.8  # [-], approximate load of the finite elements there over that of the column model
COARSE_INCREMENTS = 4  # of the first fit
COARSE_AGREEMENT = 5e-3  # [-], of the first fit with its data; its forces scatter by 2e-3
STEADY_TOLERANCE = 1e-3  # [-], of the two forces, in incremental rolling
BEYOND_COLUMNS = tuple(f"mix.overrides.{name}" for name in ASSUMED[:3])  # on which the column model hardly depends
BROYDEN_LENGTH = 2e-3  # [-], change of the unknowns with half the weight in the update of the slopes
START_LOGIT = 0.4  # [-], logit of the initial density ratio between loose and required, 0.94 for 0.98


Contact = Callable[[Scene, Any], ContactResult]  # of a scene and a measurement


@dataclass(frozen=True)
class Refit:
    """Calibrated parameters with one datum or assumption at a bound.

    Parameters
    ----------
    heckel_slope : float
        One-dimensional Heckel slope [1/Pa]; nan without solution.
    fed_density_ratio : float
        Initial density ratio [-]; nan without solution.
    """

    name: str
    value: float
    heckel_slope: float = np.nan
    fed_density_ratio: float = np.nan
    reason: str = ""


@dataclass(frozen=True)
class Calibration:
    """Result of a calibration.

    Parameters
    ----------
    scene : Scene
        Scene with the calibrated parameters.
    model : _Model
        Data and unknowns.
    fit : SpaceMappingFit
        In (ln K_H, logit of k), with misfit, sensitivity and the runs of the finite elements.
    rolled : tuple of Contact
        Contact of each measurement.
    elements : optional
        Finite-element model; None for columns.
    coarse : Calibration, optional
        Calibration on COARSE_INCREMENTS, the initial guess of this one.
    """

    scene: Scene
    model: "_Model"
    fit: SpaceMappingFit
    rolled: tuple[ContactResult, ...]
    elements: Contact | None = None
    coarse: "Calibration | None" = None

    @cached_property
    def refits(self) -> tuple[Refit, ...]:
        """Parameters at every bound of data and assumptions, by fits of the corrected column model."""
        model, known, found = self.model, scene_mix(self.model.scene), []
        for i, (name, band) in enumerate(model.data):
            for bound in {band.low, band.high} - {band.value}:
                found.append(self._refit(name, bound, {}, [*model.values[:i], bound, *model.values[i + 1 :]]))
        spreads = {f"mix.overrides.{name}": known.parameter(name) for name in ASSUMED}
        assumed = {key: (each.low, each.high) for key, each in spreads.items() if each.low < each.high}
        for key, bounds in (assumed | model.measured.assumptions).items():
            found += [self._refit(key, bound, {key: bound}, model.values) for bound in bounds]
        return tuple(found)

    def _refit(self, name: str, bound: float, keys: Mapping[str, float], values: Sequence[float]) -> Refit:
        """Fit the column model of the scene with other keys to values, with the correction of the fit."""
        if self.fit.history and name in BEYOND_COLUMNS:
            return Refit(name, bound, reason=f"columns do not depend on it; calibrate with --set {name}={bound:g}")
        try:
            model = replace(self.model, scene=self.model.scene.replaced(**keys))
            again = fit_parameters(model.predicted, values, model.start, correction=self.fit.correction)
            found = model.scene_at(again.unknowns)
        except (ValueError, RuntimeError) as error:
            return Refit(name, bound, reason=reason_of(error))
        return Refit(name, bound, scene_mix(found).heckel_slope, found.layer.fed_density_ratio)

    @property
    def heckel_slope(self) -> float:
        """One-dimensional Heckel slope K_H, as in mix tables [1/Pa]."""
        return scene_mix(self.scene).heckel_slope

    @property
    def fed_density_ratio(self) -> float:
        """Initial density ratio k [-]."""
        return self.scene.layer.fed_density_ratio

    @property
    def scene_changes(self) -> dict[str, Any]:
        """Keys that enter the fit into the scene, and where it holds; earlier fits are scaled to the same place."""
        mix, before = self.scene.mix, self.scene.mix.fitted_at
        fits = mix.scaled_fits | {"heckel_slope": self.heckel_slope}
        names = (*self.model.unknowns, *(before.parameters if before else ()))
        place = {"moisture": mix.moisture, "density_ratio": mix.density_ratio, "parameters": list(dict.fromkeys(names))}
        place["engine"] = "column" if self.elements is None else "compaction"
        changes = {f"mix.overrides.{name}": value for name, value in fits.items()}
        return changes | {"layer.fed_density_ratio": self.fed_density_ratio, "mix.fitted_at": place}

    @property
    def sensitivity(self) -> Array:
        """Relative change of each unknown over that of each datum [-], shape (unknowns, data)."""
        k, required = self.fed_density_ratio, self.scene.mix.density_ratio
        by_logit = (k - LOOSE) * (required - k) / (required - LOOSE) / k  # d ln k/d logit
        scales = {"heckel_slope": 1.0, "fed_density_ratio": by_logit}
        return self.fit.sensitivity * np.array([[scales[name]] for name in self.model.unknowns])


def calibrate(
    scene: Scene,
    measured: plant_data.Measured,
    engine: str = "column",
    unknowns: Sequence[str] = UNKNOWNS,
    initial_guess: Calibration | None = None,
    **options: Any,
) -> Calibration:
    """Calibrate the mix of a scene to measurements.

    Parameters
    ----------
    engine : {"column", "compaction"}
    unknowns : sequence of str
        Of UNKNOWNS, at most as many as there are data.
    initial_guess : Calibration, optional
        Calibration by finite elements with another mix, mesh or data.
    **options
        Keywords of the engine "compaction", such as `increments`. Without `initial_guess` the mix is calibrated on
        COARSE_INCREMENTS first.

    Raises
    ------
    SceneError
        If there are more unknowns than data, an assumption is no number of the scene, or the scene prescribes a target.
    RuntimeError
        If no trial agrees with the data.

    Notes
    -----
    Finite elements take minutes and agree with the data to 2e-3, twice the tolerance of a steady force; the coarse fit
    shows the effect of the mesh. Refits are by the corrected column model, without two-dimensional effects: calibrate
    again if a roller length changes the ratio of cohesion and pressure.
    """
    unfit = [
        f"contact.{name}: a calibration compacts the product to its density; delete {value:g} from the scene"
        for name, value in scene.target.items()
    ]
    if scene.mix.pore_air != "drained":
        words = "a calibration has contacts without pore air; delete the key, and give forces of slow rolling"
        unfit.append(f'mix.pore_air: {words}, got "{scene.mix.pore_air}"')
    if unfit:
        raise SceneError(unfit)
    for key, bounds in measured.assumptions.items():
        scene.require_fields(**{key: bounds[0]})
    model, guess, count = _Model(scene, measured, tuple(unknowns)), initial_guess, len(measured.measurements)
    if guess and (guess.elements is None or guess.model.unknowns != model.unknowns or len(guess.rolled) != count):
        fitted = f"has fitted {', '.join(unknowns)} to {count} measurements"
        raise ValueError(f"`initial_guess` must be a calibration of finite elements that {fitted}")
    elements, fine, start, coarse = None, None, model.start, None
    rolled: dict[Any, ContactResult] = {}  # by finite elements, in the last trial
    if engine == "compaction":
        if guess is None and options.get("increments") != COARSE_INCREMENTS:
            guess = coarse = calibrate(scene, measured, engine, unknowns, **options | {"increments": COARSE_INCREMENTS})
        elements = partial(_by_elements, options, rolled)
        fine, start = partial(model.predicted, contact=elements), guess.fit.unknowns if guess else model.shallow_start
    correction = guess.fit.correction if guess else None
    agreement = 2 * options.get("steady_tolerance", STEADY_TOLERANCE)  # by which two contacts may differ
    if options.get("increments") == COARSE_INCREMENTS:
        agreement = max(agreement, COARSE_AGREEMENT)
    numerics = {"correction": correction, "broyden_length": BROYDEN_LENGTH, "agreement": agreement}
    try:
        fit = fit_parameters(model.predicted, model.values, start, fine, **numerics)
    except ValueError as error:
        of_trial = isinstance(error, SceneError) or "density_ratio" in str(error)
        words = "no slope and initial density ratio give these data" if of_trial else f"{error}; the fit is"
        words += f" by {engine} on a lift of {scene.lift_thickness:g} m"
        remedy = "use --engine compaction, a higher layer.lift_thickness, or fewer --parameters"
        raise SceneError([f"{words}; {remedy}"]) from error
    found = model.scene_at(fit.unknowns)
    contacts = (rolled[each] if elements else _column(found, each) for each in measured.measurements)
    return Calibration(found, model, fit, tuple(contacts), elements, coarse)


def _as_measured(scene: Scene, measurement: Any) -> tuple[Scene, float]:
    """Return scene and speed [m/s] of a measurement."""
    if measurement.exit_density_ratio is not None:
        scene = scene.replaced(**{"mix.density_ratio": measurement.exit_density_ratio})
    return scene, measurement.speed or scene.mean_speed


def _column(scene: Scene, measurement: Any) -> ContactResult:
    """Compute the contact of a measurement by the column model."""
    scene, speed = _as_measured(scene, measurement)
    return roll_scene(scene, scene_mix(scene), speed, "column")


@dataclass(frozen=True)
class _Model:
    """Predictions of the data for a scene with unknown parameters: ln K_H, and the logit of k.

    k = loose + (required - loose)/(1 + exp(-logit))
    """

    scene: Scene
    measured: plant_data.Measured
    unknowns: tuple[str, ...]

    @property
    def data(self) -> list[tuple[str, Any]]:
        """Name and band of each datum."""
        return [each for measurement in self.measured.measurements for each in measurement.data]

    @property
    def values(self) -> list[float]:
        """Values of the data."""
        return [band.value for _, band in self.data]

    @property
    def start(self) -> Array:
        """Unknowns of the scene."""
        share = (self.scene.layer.fed_density_ratio - LOOSE) / (self.scene.mix.density_ratio - LOOSE)
        known = {
            "heckel_slope": np.log(scene_mix(self.scene).heckel_slope),
            "fed_density_ratio": logit(share) if 0 < share < 1 else START_LOGIT,
        }
        return np.array([known[name] for name in self.unknowns])

    @property
    def shallow_start(self) -> Array:
        """Unknowns of a small contact angle with about the load, for the first trial of the finite elements."""
        start, required, names = self.start, self.scene.mix.density_ratio, [name for name, _ in self.data]
        if "fed_density_ratio" in self.unknowns:
            strain = START_ANGLE**2 * self.scene.machine.roller_radius / (2 * self.scene.lift_thickness)
            at = self.unknowns.index("fed_density_ratio")
            start[at] = np.fmax(start[at], logit((required * (1 - strain) - LOOSE) / (required - LOOSE)))
        if "heckel_slope" in self.unknowns and "load" in names:
            load = names.index("load")
            ratio = self.predicted(start)[load] / self.values[load]
            start[self.unknowns.index("heckel_slope")] += np.log(PLANE_STRAIN_FACTOR * ratio)
        return start

    def scene_at(self, u: Array) -> Scene:
        """Return the scene with the unknowns `u`; the Heckel slope of a trial has no limits."""
        known, required = dict(zip(self.unknowns, u.tolist(), strict=True)), self.scene.mix.density_ratio
        changes: dict[str, Any] = {}
        if "heckel_slope" in known:
            changes["mix.overrides.heckel_slope"] = float(np.exp(known["heckel_slope"]))
            changes["unusual"] = (*self.scene.unusual, "mix.overrides.heckel_slope")
        if "fed_density_ratio" in known:
            changes["layer.fed_density_ratio"] = LOOSE + (required - LOOSE) * float(expit(known["fed_density_ratio"]))
        return self.scene.replaced(**changes)

    def predicted(self, u: Array, contact: Contact = _column) -> Array:
        """Predict the data for the unknowns `u` by a function of scene and measurement, by columns by default."""
        trial, length, values = self.scene_at(u), self.scene.machine.roller_length, []
        for measurement in self.measured.measurements:
            known = on_roller(contact(trial, measurement), length)
            of_all = trial.machine.rollers * known["resistance"]
            forces = balance(machine_models.cart(trial, known["load"]), 0.0, of_all, 1.0)
            known["cart_force"] = float(forces.drive_force)
            values += [known[name] for name, _ in measurement.data]
        return np.array(values)


def _by_elements(
    options: dict[str, Any], rolled: dict[Any, ContactResult], scene: Scene, measurement: Any
) -> ContactResult:
    """Compute and keep the contact of a trial by finite elements, from scratch and at the required density."""
    from compact.engines.column.engine import required_feed
    from compact.engines.compaction import engine as compaction

    scene, speed = _as_measured(scene, measurement)
    case, required = case_of(scene, scene_mix(scene), speed, "compaction"), scene.mix.density_ratio
    layer, material = case.layer, case.material
    feed = required_feed(layer.height, required, material, speed, radius=case.roller.radius)
    roller = replace(case.roller, indentation=layer.height * feed.indentation / feed.height)
    options = {"steady_tolerance": STEADY_TOLERANCE} | options
    rolled[measurement] = compaction.roll(layer, roller, material, speed, exit_density_ratio=required, **options)
    return rolled[measurement]


# the drive


@dataclass(frozen=True)
class Estimate:
    """Value of repeated readings.

    Parameters
    ----------
    value : float
        Value in its unit.
    error : float
        Standard error; nan where no reading is left over.
    freedom : int
        Readings that are left over.
    """

    value: float
    error: float
    freedom: int

    @property
    def spread(self) -> float:
        """Half-width of the confidence interval over the value [-]; nan without a standard error."""
        width = student.ppf((1 + CONFIDENCE) / 2, self.freedom) * self.error if self.freedom else np.nan
        return float(abs(width / self.value)) if self.value else np.nan

    @property
    def origin(self) -> str:
        """Origin as the comment of a scene states it, with the spread."""
        return "measured" if np.isnan(self.spread) else f"measured ± {100 * self.spread:.2g} %"


DRIVE_UNITS = {"stiffness": "N/m", "damping": "N s/m", "backlash": "m"}


def calibrate_drive(scene: Scene, measured: plant_data.Measured) -> dict[str, Estimate]:
    """Determine stiffness, damping and backlash of an elastic drive from deflection and tap tests.

    Returns
    -------
    dict of str to Estimate
        By the names of `DRIVE_UNITS`, without those that no test determines, and "tapped_stiffness", m omega^2 [N/m].

    Raises
    ------
    SceneError
        If the deflections do not determine a positive stiffness.
    """
    mass, found = scene.machine.mass, dict[str, Estimate]()
    if measured.taps:
        rates = np.array([tap.natural_frequency for tap in measured.taps])
        found["stiffness"] = found["tapped_stiffness"] = _mean(mass * rates**2)
        found["damping"] = _mean(2 * mass * rates * [tap.damping_ratio for tap in measured.taps])
    return found | (_bent(measured.deflections) if measured.deflections else {})


def _mean(values: Sequence[float] | Array) -> Estimate:
    """Return mean and standard error of repeated values."""
    freedom = len(values) - 1
    error = np.std(values, ddof=1) / np.sqrt(len(values)) if freedom else np.nan
    return Estimate(float(np.mean(values)), float(error), freedom)


def _bent(readings: Sequence[plant_data.Deflection]) -> dict[str, Estimate]:
    """Fit a line of deflection over force by least squares; stiffness, and backlash where both signs are read.

    One reading has its zero at no deflection. SceneError if the deflections do not determine a positive stiffness.
    """
    force, deflection = np.array([(each.force, each.deflection) for each in readings]).T
    both = min(np.sum(force > 0), np.sum(force < 0)) >= 2  # so that slope and backlash are told apart
    columns = [force, np.ones_like(force), np.sign(force) / 2][: 3 if both else min(2, len(force))]
    terms, freedom = np.column_stack(columns), len(force) - len(columns)
    (compliance, *others), _, rank, _ = np.linalg.lstsq(terms, deflection)
    if rank < len(columns) or not compliance > 0:
        words = "the readings have no positive slope; read force and deflection at two loads"
        raise SceneError([f"drive.stiffness: {words}"])
    residuals = terms @ [compliance, *others] - deflection
    variance = residuals @ residuals / freedom if freedom else np.nan
    errors = np.sqrt(variance * np.diag(np.linalg.inv(terms.T @ terms)))
    found = {"stiffness": Estimate(float(1 / compliance), float(errors[0] / compliance**2), freedom)}
    return found | ({"backlash": Estimate(float(others[1]), float(errors[2]), freedom)} if both else {})


def with_scene_lines(lines: Iterable[str], values: Mapping[str, str]) -> str:
    """Return a text, and the lines for the tables of the scene of values by key, each with its comment."""
    tables: dict[str, list[str]] = {}
    for key, value in values.items():
        table, _, name = key.rpartition(".")
        tables.setdefault(table, [f"[{table}]"]).append(f"{name} = {value}")
    return "\n".join([*lines, "", "for the scene:", *(line for each in tables.values() for line in each)])


def drive_digest(found: Mapping[str, Estimate], mass: float) -> str:
    """Describe a calibration of the drive in text: values, standard errors, and the lines for the scene.

    Parameters
    ----------
    mass : float
        Mass of the cart [kg].
    """
    lines, values, stiffness = [], {}, found["stiffness"]
    for name, unit, each in ((name, unit, found[name]) for name, unit in DRIVE_UNITS.items() if name in found):
        told = "one reading, no error" if np.isnan(each.error) else f"standard error {each.error:.2g} {unit}"
        lines.append(f"{name:<12}{each.value:>12.5g} {unit:<6} {told}")
        values[f"drive.{name}"] = f"{each.value:.6g}  # {unit}; {each.origin}"
    if "damping" in found:
        ratio = found["damping"].value / (2 * np.sqrt(stiffness.value * mass))
        lines.append(f"damping ratio {ratio:.3g} with the cart of {mass:g} kg")
    if (tapped := found.get("tapped_stiffness", stiffness)) is not stiffness:
        swinging = stiffness.value / tapped.value * mass
        lines.append(f"the frequency is that of {swinging:.4g} kg on this stiffness, the scene has {mass:g} kg")
    return with_scene_lines(lines, values)


def fit_slope(readings: Sequence[plant_data.Compression]) -> Estimate:
    """Fit the curve of the mix, K_H p = ln[(1 - k0)/(1 - k)] from loose mix k0, to readings of confined compression.

    Raises
    ------
    SceneError
        If a reading is no denser than loose mix.
    """
    loosest = min(each.density_ratio for each in readings)
    if loosest <= LOOSE:
        raise SceneError([f"compression: density_ratio must be above that of loose mix, {LOOSE:g}, got {loosest:g}"])
    return _mean([np.log((1 - LOOSE) / (1 - each.density_ratio)) / each.pressure for each in readings])


def slope_digest(scene: Scene, found: Estimate) -> str:
    """Describe a fit of the Heckel slope at the moisture of a scene in text, with the lines for it."""
    lines = [f"Heckel slope {found.value * 1e6:.3g} per MPa by {found.freedom + 1} readings of confined compression"]
    if found.value <= constraints.STATIC_SLOPES[2]:
        words = "a slope as of unkneaded mix, for process.kneading"
        lines.append(f"{words}; a pass over kneaded mix has about three times it")
    values = {
        "mix.overrides.heckel_slope": f"{found.value:.4g}  # 1/Pa; {found.origin}",
        "mix.fitted_at.moisture": f"{scene.mix.moisture:g}",
        "mix.fitted_at.density_ratio": f"{scene.mix.density_ratio:g}",
        "mix.fitted_at.parameters": '["heckel_slope"]',
    }
    return with_scene_lines(lines, values)


def value_lines(scene: Scene, values: Sequence[plant_data.KeyValue]) -> str:
    """Return the lines for the scene of measured values, after validation of each; SceneError for a mistake."""
    scene.require_fields(**{each.key: each.value for each in values})
    given = ((each, schema.unit_of(each.key)) for each in values)
    lines = {each.key: f"{each.value:g}  #{unit}; measured ± {each.error:g}{unit}" for each, unit in given}
    return with_scene_lines((), lines).lstrip()


def kneading_digest(found: KneadingFit) -> str:
    """Describe a fit of kneading in text, with the lines for the scene."""
    slopes, (gain, exponent) = found.static_slopes, (found.kneading.gain, found.kneading.exponent)
    lines = [f"static Heckel slope {slope * 1e6:.3g} per MPa {name}".rstrip() for name, slope in slopes.items()]
    lines.append(f"gain {gain:.3g} at the first gyration, exponent {exponent:.3g}; rms of the density {found.rms:.2g}")
    mean = float(np.exp(np.mean(np.log([*slopes.values()]))))
    values = {
        "mix.overrides.heckel_slope": f"{mean:.4g}  # 1/Pa; static, measured",
        "process.kneading": f"[{gain:.4g}, {exponent:.4g}]  # measured",
    }
    return with_scene_lines(lines, values)


def calibration_digest(calibration: Calibration) -> str:
    """Describe a calibration in text: data, parameters, sensitivity, bounds, and the lines for the scene."""
    fit, coarse, unknowns = calibration.fit, calibration.coarse, calibration.model.unknowns
    width, title = 12 * len(unknowns), f"change of {' and '.join(unknowns)} by 1 % more"
    lines = [f"{'measured':<26}{'value':>12}{'misfit':>10}{title:>{max(width, len(title) + 2)}}"]
    for each in calibration_summary(calibration)["data"]:
        moves = "".join(f"{change:>+10.3f} %" for change in each["sensitivity"])
        lines.append(f"  {each['name']:<24}{each['value']:>12.6g}{abs(np.expm1(each['misfit'])):>10.1e}{moves}")
    if fit.history and fit.correction:
        ratios = zip(calibration.model.data, np.exp(fit.correction.ratio), strict=True)
        found = ", ".join(f"{name} {ratio:.4f}" for (name, _), ratio in ratios)
        lines.append(f"by {len(fit.history)} runs of finite elements; ratio to columns: {found}")
    for words, each in (("calibrated", calibration), (f"on {COARSE_INCREMENTS} increments", coarse)):
        if each:
            found = f"K_H {each.heckel_slope * 1e6:.4f} /MPa (one-dimensional), fed {each.fed_density_ratio:.5f}"
            lines.append(f"{words} {found}")
    lines.append(f"{'bound of':<36}{'is':>12}{'K_H, 1/MPa':>14}{'fed density':>14}")
    for refit in calibration.refits:
        found = f"{refit.heckel_slope * 1e6:>14.3f}{refit.fed_density_ratio:>14.4f}"
        lines.append(f"  {refit.name:<34}{refit.value:>12.5g}{f'  none: {refit.reason}' if refit.reason else found}")
    return "\n".join([*lines, "", fitted_lines(calibration)])


def fitted_lines(calibration: Calibration) -> str:
    """Return the lines for the scene of a calibration, with the error of measured forces."""
    *fits, (place, held) = calibration.scene_changes.items()
    readings = calibration.model.measured.measurements
    errors = [each.error for each in readings if each.error is not None]
    origin = f"measured ± {100 * max(errors):.2g} %" if len(errors) == len(readings) else "fitted"
    values = {key: f"{value:.6g}  #{schema.unit_of(key) or ' -'}; fitted" for key, value in fits}
    values |= {f"{place}.{name}": json.dumps(value) for name, value in held.items()}
    values[f"{place}.parameters"] += f"  # {origin}"
    return with_scene_lines((), values).lstrip()


def calibration_summary(calibration: Calibration) -> dict[str, Any]:
    """Convert a calibration to plain numbers for JSON, SI."""
    data = zip(calibration.model.data, calibration.fit.misfit, calibration.sensitivity.T, strict=True)
    return {
        "scene_hash": calibration.scene.hash,
        "scene_changes": calibration.scene_changes,
        "heckel_slope": calibration.heckel_slope,
        "fed_density_ratio": calibration.fed_density_ratio,
        "fitted": calibration.model.unknowns,
        "data": [
            {"name": name, "value": band.value, "misfit": off, "sensitivity": moves}
            for (name, band), off, moves in data
        ],
        "runs": [{"unknowns": u, "misfit": misfit} for u, misfit in calibration.fit.history],
        "refits": [vars(refit) for refit in calibration.refits],
    }
