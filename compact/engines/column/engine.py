"""Engine "column": a compacting layer as columns that the roller presses one by one; one pass and many.

    h(x) = h_min + gap(x),    P = int s_v dx,    F = int s_v gap' dx = closed integral of s_v dh

Each column is compressed as between smooth walls (`confined`), from the front edge, where the fed height is met, to the
rear edge, where its rebound ends and s_v = 0. This is what a wide thin bonded layer does without friction; of its
distance to two dimensions, of second order in height over contact length, nothing is in `error`. F is the work that the
layer keeps: it depends on the lowest height alone, not on radius or profile, and on speed only through pc.

Mass is counted in the height that grains and water fill, density ratio times height: no roller can leave less room.
Several passes, and new mix on old, are columns on top of one another that share s_v and carry their state.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from compact.engines.column.column_ode import OWN, STRESS, Profile
from compact.engines.column.column_pass import LONGEST, PLATE, STIFFEST, STRAINS, Column, bed_of
from compact.material.laws import Compaction
from compact.numerics.validation import require_finite, require_known, require_nonnegative, require_positive
from compact.rolling_contact import ContactResult, require_on_target, require_target_reached

__all__ = ["Column", "ColumnContactResult", "Feed", "Oedometer", "feed", "oedometer", "roll", "roll_over"]

RTOL = 1e-9  # error of a step of the integration, over the size of the whole pass
LOOSER = 100.0  # times `rtol`: what this changes is the error that is reported, and `rtol` besides
ROUGH = 1e-5  # `rtol` of a search, until what is wanted is met within it
NEAR = 0.05  # share of `rtol` within which what is wanted is met; twice as much after each try, for other steps
ENOUGH = 1.0  # the same share where the first pass is likely to meet it
TARGET = 10.0  # times `rtol`, relative, within which what is prescribed is met in the end
LEAST_RISE = 1e-2  # of a density ratio, to which its miss is relative at least
SEARCHED = 60  # passes of a search; 6 are usual
PRESSED = 0.8  # of the deepest stress, a mean over the front that a search starts from
RESISTED = 1e-3  # share of the load below which a resistance counts as none, theory.md 3.1


@dataclass(frozen=True, kw_only=True)
class ColumnContactResult(ContactResult):
    """A `ContactResult` with what the columns know besides.

    Its `error` is that of the arithmetic, what a looser integration changes: of the distance of columns to a layer in
    two dimensions, or of the mix to its law, it tells nothing. Its `work_residual` is rounding alone.

    indentation : of the lowest generatrix below the height before the pass [m]
    exit_height : after the rebound [m];  exit_density_ratio : k then, mean over this height
    columns : `Column`s after the pass, from the base upwards: what the next pass meets
    plastic_work : part of the resistance that flow takes [N/m]; the rest stays as elastic energy, locked in
    mass_residual : under the lowest generatrix, the height that the mix needs by its density and elastic strain over
        the height that is there, less 1
    evaluations : of the rates of the columns
    """

    indentation: float
    exit_height: float
    exit_density_ratio: float
    columns: tuple[Column, ...]
    plastic_work: float
    mass_residual: float
    evaluations: int


@dataclass(frozen=True)
class Feed:
    """Height of mix to feed and indentation [m] that leave a product as wanted."""

    height: float
    indentation: float


@dataclass(frozen=True)
class Oedometer:
    """Confined compression at every `pressure` s_v [Pa], shape (n,).

    strain : (h_in - h)/h_in;  lateral_stress : s_h [Pa];  density_ratio : k
    """

    pressure: np.ndarray
    strain: np.ndarray
    lateral_stress: np.ndarray
    density_ratio: np.ndarray


def roll(layer, roller, material, speed, **options):
    """One pass over a layer of fresh mix, a `ColumnContactResult`: the engine "column".

    Parameters
    ----------
    layer : Layer, its height that of the mix as fed; bonded, without plies
    roller : Roller, any profile ("deformed" is the circle, since columns move up and down only), with an indentation,
        load or peak pressure that leaves more room than grains and water fill; "frictionless" or "free", which is the
        same to columns
    material : Compaction
    speed : of the roller along x [m/s], not 0; pc is larger by `material.rate_factor(speed)`
    options : those of `roll_over`

    For speed < 0 leading and trailing stay + ahead, while x and resistance keep the fixed axis x.

    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Compaction(120e6, 0.3, heckel_slope=13e-6, loose_density_ratio=0.72, critical_slope=1.2,
    ...                  tensile_strength=14e3, fed_density_ratio=0.94)
    >>> fed = feed(0.22, 0.98, mix, speed=0.2)
    >>> rolled = roll(Layer(fed.height), Roller(0.11, indentation=fed.indentation, profile="circle"), mix, speed=0.2)
    >>> f"P {rolled.load:.0f} N/m, F/P {rolled.resistance / rolled.load:.3f}, k {rolled.exit_density_ratio:.3f}"
    'P 10035 N/m, F/P 0.165, k 0.980'
    """
    _refuse_other_layers(layer)
    _refuse_other_materials(material)
    fed = Column(layer.height, material.fed_density_ratio)
    return roll_over((fed,), roller, material, speed, **options)


def roll_over(columns, roller, material, speed, *, exit_density_ratio=None, strain="logarithmic", rtol=RTOL):
    """One pass over `Column`s on top of one another, given from the base upwards; all else as `roll` has it.

    exit_density_ratio : mean wanted behind the roller, in place of what the roller prescribes
    strain : "logarithmic", which is true to mass; "small", or "mass-true", small with k = k_in/(1 - V); small strains
        count from the heights before the pass
    rtol : error of a step of the integration, over the size of the whole pass
    """
    _refuse_beyond_columns(roller, material, speed)
    require_known("strain", strain, STRAINS)
    require_positive(rtol=rtol)
    there = bed_of(columns, material, material.rate_factor(speed), _profile(roller), STRAINS[strain])
    _refuse_stiffer(there, material)
    if exit_density_ratio is None:
        passage, searched = _pressed(there, roller, rtol)
    else:
        passage, searched = _dense(there, exit_density_ratio, rtol)
    looser = there.passed(passage.indentation, LOOSER * rtol)
    rolled = _rolled(passage, looser, rtol, np.sign(speed), searched)
    require_on_target(rolled, roller, TARGET * rtol, exit_density_ratio=exit_density_ratio)
    return rolled


def feed(height, exit_density_ratio, material, speed, *, rtol=RTOL):
    """The `Feed` for a product of a height [m] and `exit_density_ratio` k [-] after one pass and its rebound.

    Both lengths go with the height, so the indentation of a layer of given fed height follows by the rule of three.
    """
    require_positive(height=height)
    _refuse_other_materials(material)
    fed = Column(1.0, material.fed_density_ratio)
    there = bed_of((fed,), material, material.rate_factor(speed), PLATE, STRAINS["logarithmic"])
    _refuse_stiffer(there, material)

    passage, _ = _leaving(there, exit_density_ratio, rtol)
    require_target_reached("exit_density_ratio", exit_density_ratio, passage.density_ratio, TARGET * rtol)
    scale = height / passage.columns[0].height
    return Feed(height=scale, indentation=scale * passage.indentation)


def oedometer(material, pressure, *, rate_factor=1.0, rtol=RTOL):
    """Confined compression of fresh mix through each `pressure` s_v [Pa] in turn, up or down: an `Oedometer`.

    rate_factor : by which pc is larger than at the reference speed

    >>> mix = Compaction(120e6, 0.3, heckel_slope=13e-6, loose_density_ratio=0.72, critical_slope=1.2,
    ...                  tensile_strength=14e3, fed_density_ratio=0.94)
    >>> test = oedometer(mix, (100e3, 200e3, 0.0))
    >>> [f"{k:.4f}" for k in test.density_ratio], f"{test.lateral_stress[-1] / 1e3:.0f} kPa stay"
    (['0.9400', '0.9707', '0.9707'], '43 kPa stay')
    """
    _refuse_other_materials(material)
    pressure = np.atleast_1d(np.asarray(pressure, dtype=float))
    require_nonnegative(pressure=pressure)
    require_positive(rate_factor=rate_factor, rtol=rtol)
    there = bed_of((Column(1.0, material.fed_density_ratio),), material, rate_factor, PLATE, STRAINS["logarithmic"])
    _refuse_stiffer(there, material)
    y, scale, rows = there.rest, there.scale(there.deepest, rtol), []
    for stress in pressure.tolist():
        way = -1.0 if stress > y[STRESS] else 1.0
        path, there, _ = there.travelled(0.0, way, y, stress, scale)
        y = path[-1, 1:]
        rows.append((stress, 1 - there.heights(y)[0], 1.5 * y[OWN] - stress / 2, there.density_ratios(y)[0]))
        if not rows[-1][1] < 1 - material.fed_density_ratio:
            raise ValueError(f"`pressure` must leave pores open, got {stress!r} Pa, which shuts them")
    return Oedometer(*np.array(rows).T)


def _profile(roller):
    return Profile(float(roller.radius), 0.0 if roller.profile == "parabola" else 1.0)


def _pressed(there, roller, rtol):
    """The `Passage` that meets what the roller prescribes, and the evaluations spent in search of it."""
    name, value = roller.target
    if name == "load":
        return _loaded(there, value, rtol)
    if name == "peak_pressure":
        return _peaked(there, value, rtol)
    if not value < there.deepest:
        _refuse_beyond(there, "indentation", value, there.deepest)
    return there.passed(value, rtol, LONGEST), 0


def _peaked(there, pressure, rtol):
    """The `Passage` with a peak pressure [Pa], and the evaluations spent in search of it.

    The stress under the lowest generatrix is that under a plate.
    """
    plate, scale = replace(there, profile=PLATE), there.scale(there.deepest, rtol)
    path, _, spent = plate.travelled(there.deepest, 0.0, there.rest, float(pressure), scale)
    if path[-1, 1 + STRESS] < pressure:
        _refuse_beyond(there, "peak_pressure", pressure, path[-1, 1 + STRESS])

    def miss(passage):
        return passage.peak_pressure / pressure - 1

    depth = there.deepest - path[-1, 0]
    passage, searched = _met(_passes(there, rtol), miss, depth, 1.0, there.deepest, rtol=rtol, near=ENOUGH)
    if passage is None:
        _refuse_beyond(there, "peak_pressure", pressure, path[-1, 1 + STRESS])
    return passage, spent + searched


def _passes(there, rtol):
    """passed(indentation, tolerance) of `_met`: with points for a picture where the tolerance is the last."""

    def passed(depth, tolerance):
        return there.passed(depth, tolerance, math.inf if tolerance > rtol else LONGEST)

    return passed


def _loaded(there, load, rtol):
    """The `Passage` under a load [N/m], and the evaluations spent in search of it."""

    def about(depth):
        return PRESSED * there.stress(depth) * there.edge(depth) - load

    def miss(passage):
        return math.log(passage.load / load)

    start = brentq(about, 0, there.deepest, rtol=0.1) if about(there.deepest) > 0 else there.deepest
    passage, spent = _met(_passes(there, rtol), miss, start, 1.0, there.deepest, rtol=rtol, rough=max(ROUGH, rtol))
    if passage is None:
        _refuse_beyond(there, "load", load, there.passed(there.deepest, rtol).load)
    return passage, spent


def _met(passed, miss, start, slope, deepest, *, rtol, rough=None, shallowest=0.0, near=NEAR, most=TARGET):
    """The `Passage` whose `miss` is 0, None where the deepest one falls short, and the evaluations spent besides.


    passed : the `Passage` at an indentation [m], integrated to a tolerance: `rough` in the search, `rtol` at its end
    miss : of a passage, relative, rising with its indentation;  start : a guess;  slope : d miss/d ln indentation
    shallowest : indentation with a miss < 0 [m], or 0;  near, most : shares of `rtol`
    that the miss may be at first, and in the end

    Inverse interpolation of ln indentation through the last three passes, rough ones first: what a finer integration
    adds to one of them, it adds to all.
    """
    tolerance = rough or rtol
    bottom, top = math.log(shallowest) if shallowest else -math.inf, math.log(deepest)
    low, high, x, tried, topped = bottom, top, math.log(start), [], False
    near, spent = near * rtol, 0
    for _ in range(SEARCHED):
        limited = x >= top  # the deepest pass is tried itself
        x = min(x, top)
        passage = passed(deepest if limited else math.exp(x), tolerance)
        off = miss(passage)
        topped = topped or limited
        if tolerance == rtol:
            if abs(off) <= near:
                return passage, spent
            near = min(2 * near, most * rtol)
        spent += passage.evaluations
        if limited and off < 0 and tolerance == rtol:
            return None, spent
        if tried and tried[-1][0] == x:  # the same pass, finer
            tried = [(place, other + off - tried[-1][1]) for place, other in tried]
        else:
            tried = [*tried[-2:], (x, off)]
        if tolerance > rtol and (abs(off) <= tolerance or (limited and off < 0)):
            low, high, topped, tolerance = bottom, top, False, rtol
            continue
        low, high = (x, high) if off < 0 else (low, x)
        x = _interpolated(tried) if len(tried) > 1 else x - off / slope
        if not (low < x < high or (x >= top and not topped)):
            x = (low + high) / 2 if low > -math.inf else high - 1
            x = x if topped or off > 0 else top
    raise RuntimeError(
        f"no indentation found in {SEARCHED} passes; the last missed by {off:.1e} at {passage.indentation:.6g} m"
    )


def _interpolated(tried):
    """Place at which a parabola through (place, miss) on its side has no miss; a line through two."""
    shares = [math.prod(b / (b - a) for _, b in tried if b != a) for _, a in tried]
    return sum(share * place for share, (place, _) in zip(shares, tried, strict=True))


def _refuse_stiffer(there, material):
    """The stress of a stiff mix settles in ever shorter steps."""
    if not there.settling < STIFFEST:
        limit = material.unloading_modulus * STIFFEST / there.settling
        raise ValueError(
            f"`unloading_modulus` must be less than {limit:.3g} Pa for this mix in columns, got "
            f"{material.unloading_modulus!r}: it is rigid beside its yield limit; take a tenth of that, the resistance "
            "differs by less than 1e-3"
        )


def _dense(there, wanted, rtol):
    """The `Passage` that leaves a mean density ratio, and the evaluations spent in search of it."""

    def miss(passage):
        return passage.density_ratio / wanted - 1

    flat, spent = _leaving(there, wanted, rtol)
    depth = flat.indentation
    passage, searched = _met(
        _passes(there, rtol), miss, depth, depth / there.height, there.deepest, rtol=rtol, near=ENOUGH
    )
    return passage or flat, spent + flat.evaluations + searched


def _leaving(there, wanted, rtol):
    """The `Passage` of a plate, whatever the profile, that leaves a mean density ratio, and the evaluations besides.

    A plate goes the same way to any depth: the search goes on from an indentation that is not too deep. That is the one
    without a rebound, or less where the mix may be under tension sideways.
    """
    plate, loosest = replace(there, profile=PLATE), there.solid / there.height

    rise = max(wanted - loosest, LEAST_RISE)

    def miss(passage):
        return (passage.density_ratio - wanted) / rise

    nominal = there.height * (1 - loosest / wanted)
    if 0 < nominal < there.deepest:
        shallowest = max(there.height * (1 - loosest / wanted * math.exp(there.slack)), 0.0)
        y, pressed, spent = there.rest, plate, 0
        if shallowest:
            path, pressed, spent = plate.travelled(shallowest, 0.0, y, np.inf, plate.scale(shallowest, rtol))
            y = path[-1, 1:]

        def passed(depth, _):
            scale = plate.scale(depth, rtol)
            down, deeper, evaluations = pressed.travelled(depth - shallowest, 0.0, y, np.inf, scale)
            return deeper.released(down, depth, scale, evaluations)

        start = nominal + (there.height - nominal) * there.stress(nominal) / there.elastic
        within = {"rtol": rtol, "shallowest": shallowest, "most": TARGET * wanted / rise}
        flat, found = _met(passed, miss, start, wanted / loosest, there.deepest, **within)
        if flat is not None:
            return flat, spent + found
    densest = plate.passed(there.deepest, rtol).density_ratio
    reason = "with the circle buried to its axis" if there.buried else "that shuts all pores"
    raise ValueError(
        f"`exit_density_ratio` must lie between {loosest:.6g}, before the pass, and {densest:.6g}, left by a pass "
        f"{reason}, got {wanted!r}"
    )


def _refuse_beyond(there, name, value, limit):
    """Refuse what is prescribed beyond its limit, that at the deepest indentation."""
    full = f"grains and water alone fill the {there.solid:.6g} m that are left of {there.height:.6g} m"
    reason = "the circle is buried to its axis" if there.buried else full
    unit = {"indentation": "m", "load": "N/m", "peak_pressure": "Pa"}[name]
    raise ValueError(f"`{name}` must be less than {limit:.6g} {unit}, where {reason}, got {value:.6g} {unit}")


def _rolled(passage, looser, rtol, direction, searched):
    """The pass as seen from the fixed axis x."""
    down, up = passage.down[::-1], passage.up[::-1]
    x, pressure = np.concatenate([-up[:, 0], down[1:, 0]]), np.concatenate([up[:, 1], down[1:, 1]])
    x = passage.bed.places(x)
    forth = slice(None, None, int(direction))  # x ascends, whichever way the roller goes
    load, resistance, (plastic, elastic) = passage.load, passage.resistance, passage.work
    counted = max(abs(resistance), RESISTED * load)
    columns = passage.columns
    return ColumnContactResult(
        load=load,
        resistance=float(direction * resistance),
        leading=float(x[-1]),
        trailing=float(x[0]),
        x=(direction * x)[forth],
        pressure=pressure[forth],
        shear_traction=np.zeros_like(x),
        error=(
            abs(looser.load - load) / load + rtol,
            abs(looser.resistance - resistance) / counted + rtol,
        ),
        work_residual=abs(resistance - plastic - elastic) / counted,
        peak_pressure=passage.peak_pressure,
        indentation=float(passage.indentation),
        exit_height=sum(column.height for column in columns),
        exit_density_ratio=passage.density_ratio,
        columns=columns,
        plastic_work=plastic,
        mass_residual=passage.mass_residual,
        evaluations=passage.evaluations + looser.evaluations + searched,
    )


def _refuse_other_layers(layer):
    require_known("base", layer.base, ("bonded", "slip"))
    if layer.base == "slip":
        raise ValueError(
            "columns need a `base` that is bonded, got 'slip': there the mix gives way sideways under the roller and "
            "dilates, which no column does; use the engine compaction"
        )
    if layer.plies:
        raise ValueError(f"columns are of one mix, got {len(layer.plies)} `plies`; use the engine compaction")


def _refuse_other_materials(material):
    if not isinstance(material, Compaction):
        raise ValueError(f"columns need a `material` Compaction, got {type(material).__name__}; use spectral or fem")


def _refuse_beyond_columns(roller, material, speed):
    _refuse_other_materials(material)
    require_finite(speed=speed)
    if speed == 0:
        raise ValueError("`speed` must not be 0, got 0: the resistance is set-valued there; say which way it goes")
    require_known("rolling", roller.rolling, ("frictionless", "sliding", "free", "driven"))
    require_known("profile", roller.profile, ("parabola", "circle", "deformed"))
    if roller.friction and roller.rolling in ("sliding", "driven"):
        raise ValueError(
            f"columns carry no shear, got `rolling` '{roller.rolling}' with `friction` {roller.friction!r}; use 'free' "
            "or the engine compaction"
        )
