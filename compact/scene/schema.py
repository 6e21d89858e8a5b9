"""The tables of a scene: the one declaration of each key, with type, bounds, unit, plausible range and words.

    roller_radius: float = positive("the radius [m]", 0.01, 1.5, ROLLERS)

SI units, no default for a number. The plausible range is 0.01 to 1.5 m, and the constant states its reason. Refusals,
the schema for editors, the page and the attributes of a sweep have the same words and unit.

`machine.roller_condition` and `machine.gap_geometry` have defaults, which each engine may replace by the nearest value
that it accepts (`constraints.adapt`). A scene that sets them keeps its values or is refused.

Rules between the keys are in `constraints`; `loader` reads files into these tables and reports mistakes.
"""

import math
import re
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Annotated, Any, Literal, get_args

import pydantic
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError

from compact.engines import BUILT_IN, ENGINES
from compact.machine import drives
from compact.material.mix import CALIBRATED, is_same_state, scaled_fits
from compact.numerics.validation import Registry
from compact.quantities import CRITERIA
from compact.rolling_contact import BaseCondition, GapGeometry, RollerCondition

# The keys of `motion.LAWS`, whose import would cost seconds; a test compares the two
Law = Literal[
    "constant-velocity", "cubic", "quintic", "septic", "complex", "combined-2", "combined-3", "combined-4",
    "reversal-2", "reversal-3", "reversal-4", "reversal-3-free-acceleration", "reversal-4-free-acceleration",
    "reversal-4-free-jerk", "reversal-4-free-both", "crank", "gear-sector", "parabolic", "harmonic", "cycloidal",
    "modified-trapezoid",
]  # fmt: skip
LAW_NAMES: tuple[str, ...] = get_args(Law)
OutputItem = Literal[
    "tables", "figures", "cams", "reactions", "crank", "fields", "model_spread", "roller_motors", "report"
]
Robust = Literal["robust_peak_force", "robust_peak_power"]  # of `analysis.robust.law`
Objective = Literal["peak_force", "peak_power", "rms_force", "energy", "drawn_energy", Robust]  # of `motion.OBJECTIVES`
MixLaw = Literal["ellipse", "drucker-prager-cap"]
PoreAirModel = Literal["drained", "one-way", "coupled"]
HeldQuantity = Literal["height", "load", "peak_pressure"]
ProcessDetail = Literal["columns", "deep"]
FeedLaw = Literal["room", "even", "first"]
# names that are declared elsewhere; the last two of the fits are no parameters of a mix
EngineName = Literal[*BUILT_IN]  # type: ignore[valid-type]
DriveKind = Literal[*drives.DRIVES.own]  # type: ignore[valid-type]
RankBy = Literal[*CRITERIA]  # type: ignore[valid-type]
Fit = Literal[*CALIBRATED, "fed_density_ratio", "roller_friction"]  # type: ignore[valid-type]

# Default and largest counts
NIP_ANGLE = 20.0  # [deg], default of `process.nip_angle`
STROKES_LIMIT = 10_000  # [-], strokes on one section of a product
PASS_LIMIT = 1000  # [-], some seconds by columns, half an hour by finite elements; the mix changes in the first tens
COUNT_LIMIT = 1_000_000  # [-], beyond any machine; excludes typing errors such as 0xffff... from loops

UNIT, UNIT_WORDS = re.compile(r"\[([\w/ ]+)\]"), {"deg": "degrees"}  # in the meaning of a key

# Reasons of plausible ranges
CARTS = "forming carts weigh from tens of kilograms to tens of tonnes"
LENGTHS = "carts are metres long"
ROLLERS = "rollers of forming machines and of road rollers"
WHEELS = "guide wheels, from those of instruments to those of cranes"
SLEEVES, BEARINGS = "sleeves of feeders", "rolling bearings of wheels and rollers"
PRODUCTS = "precast products"
PART_OF_PRODUCT, PART_OF_ROLLER = "a part of the product", "a part of the roller"
STROKES = "strokes of forming machines"
BELTS = "flat belts and V-belts"
OILS, SPRINGS = "industrial hydraulics", "springs and bumpers"
MOTIONS, DRIVES, CAMS = "motions of machines", "drives of machines", "cams of machines"
ARMS = "0.0005 m for steel on steel, some millimetres for rubber"
RIBS = "ribs rub no more than the wheels resist a few times"
TORQUES = "a load of tonnes at the friction limit of a roller"
MOULDS = "moulds of forming machines advance by centimetres a second"
CREEPING = "moulds creep by centimetres in a stroke"
PRESSURES = "rolling presses with kilopascals to some megapascals"
EVEN = "1 for even pressure"
SECTIONS = "tens of strokes press a section"
ERRORS = "engines estimate errors from about 1e-5 up"
PASSES = "mix keeps its density after some tens of passes"
STATES: dict[str, Any] = {"gt": 0.72, "le": 0.99}  # density ratios of loose and pressed mix


def key(meaning: str, low: float = 0.0, high: float = 0.0, why: str = "", *, default: Any = ..., **bounds: Any) -> Any:
    """Declare a key.

    Parameters
    ----------
    meaning : str
        Words with the unit in brackets, such as "the radius [m]".
    low, high : float
        Plausible range, in the unit; none by default.
    why : str
        Origin of the range.
    default : object
        Value where the key is absent; none by default, so that the key is required.
    **bounds : object
        Limits of allowed values, as `pydantic.Field` takes them.
    """
    unit = found[1] if (found := UNIT.search(meaning)) else "1"
    words = UNIT.sub(f"in {UNIT_WORDS.get(unit, unit)}", meaning)
    extra = {"unit": unit} | ({"plausible": [low, high], "why": why} if why else {})
    return Field(default, description=words, json_schema_extra=extra if found or why else None, **bounds)


positive, nonnegative, share = partial(key, gt=0), partial(key, ge=0), partial(key, ge=0, le=1)
optional, or_zero = partial(positive, default=None), partial(nonnegative, default=None)  # a number, or none
Maybe = float | None
TOUCHES = "(zero means no contact)"


def _or_installed(registry: Registry[Any]) -> tuple[Any, ...]:
    """Return annotations of a key that takes the names of objects of other packages as well."""

    def validate(value: Any, of_this_package: Callable[[Any], Any]) -> Any:
        is_other = isinstance(value, str) and value not in registry.own and value in registry.installed
        return value if is_other else of_this_package(value)

    return pydantic.WrapValidator(validate), pydantic.PlainSerializer(str, str)


def _turn(value: Any) -> Any:
    """Return "build-up", "step", or rows of an ascending travel [m] and a share [-] as tuples."""
    if value in ("build-up", "step"):
        return value
    rows = value if isinstance(value, list | tuple) else ()
    flat: list[Any] = [x for row in rows for x in (row if isinstance(row, list | tuple) and len(row) == 2 else "?")]
    numbers = all(type(each) in (int, float) and 0 <= each < math.inf for each in flat)
    if flat and numbers and max(flat[1::2]) <= 1 and flat[::2] == sorted({*flat[::2]}):
        return tuple((float(travel), float(share)) for travel, share in rows)
    words = 'must be "build-up", "step" or rows of an ascending travel and a share from 0 to 1'
    raise PydanticCustomError("turn", words)


def _ends(value: Any) -> Any:
    """Return one number as a tuple."""
    return (value,) if type(value) in (int, float) else value


Turn = Annotated[Any, PlainValidator(_turn, json_schema_input_type=Literal["build-up", "step"] | list[list[float]])]
Ends = Annotated[tuple[Annotated[float, Field(ge=0)], ...] | None, BeforeValidator(_ends, float | list[float] | None)]


class Table(BaseModel):
    """Base of all tables: immutable, strict types, finite numbers, no unknown keys."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _tuples(cls, given: Any) -> Any:
        """Convert the lists of TOML to tuples."""
        if not isinstance(given, dict):
            return given
        return {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}


class BearingTable(Table):
    """The rolling bearings of one wheel or roller, which share its load."""

    dynamic_rating: float = positive("the basic dynamic rating C of one bearing [N]", 500, 1e7, BEARINGS)
    kind: Literal["ball", "roller"] = key("the rolling elements")
    count: int = key("the number of bearings that share the load", ge=1, le=1000)


class Machine(Table):
    """The cart, its rollers, guides and drive pin; positions are from the cart's centre, + towards the drive."""

    mass: float = positive("the mass m of the cart [kg]", 10, 1e5, CARTS)
    weight: float = positive("the weight G of the cart [N]", 100, 1e6, CARTS)  # apart: the paper rounds g to 10
    rollers: int = key("the number of rollers of one cart", ge=1, le=COUNT_LIMIT)
    roller_radius: float = positive("the radius [m]", 0.01, 1.5, ROLLERS)
    roller_length: float = positive("the length L of one roller, across the travel, [m]", 0.05, 5, ROLLERS)
    roller_positions: tuple[float, ...] = key("one position per roller [m], + towards the drive", 1e-3, 10, LENGTHS)
    guide_positions: tuple[float, ...] = key(
        "the positions of the [front, rear] guide wheels [m]", 1e-3, 10, LENGTHS, min_length=2, max_length=2
    )
    pin_position: float = key("the position of the drive pin [m], + towards the drive", 1e-3, 10, LENGTHS)
    pin_height: float = key("the height of the drive pin above the roller axle [m]", 1e-3, 5, LENGTHS)
    guide_wheel_diameter: float = positive("the diameter D of the guide wheels [m]", 5e-3, 1, WHEELS)
    guide_friction: float = share("the Coulomb coefficient at the guide wheels")
    journal_diameter: float = positive("the journal diameter d of the guide wheels [m] (eq 1.9)", 2e-3, 0.5, WHEELS)
    bearing_friction: float = share("the friction f3 of bush on journal (eqs 1.8, 1.9)")
    rolling_arm: float = nonnegative("the rolling-friction arm f4 of the guide wheels [m] (eq 1.9)", 1e-5, 0.01, ARMS)
    rib_factor: float = key("the factor f5 for rubbing of the wheel ribs, 1 for none (eq 1.9)", 1, 5, RIBS, ge=1)
    roller_friction: float = share("the friction f2 of the roller (eq 1.8)")
    feeder_sleeve: float = nonnegative("the width B_T of the feeder sleeve [m] (eq 1.2)", 5e-3, 2, SLEEVES)
    sleeve_distance: Ends = key(
        "the distance D from the axle back to fresh mix at a turn [m], one or [near, far] end; default the radius",
        5e-3, 2, SLEEVES, min_length=1, max_length=2, default=None,
    )  # fmt: skip
    overlap: float = nonnegative("the overlap b_n of neighbouring strips [m] (eqs 1.2, 1.3)", 5e-4, 0.5, PART_OF_ROLLER)
    pressure_nonuniformity: float = positive("the factor k2 for uneven pressure, 1 for even (eq 1.6)", 0.2, 5, EVEN)
    one_sided: bool = key("true for contact on the front half only (rival reading of eq 1.6), else false")
    roller_condition: RollerCondition = key("how the roller turns", default="free")
    roller_torque: Maybe = key("the torque on a roller [N m], + with its travel", 1e-3, 1e4, TORQUES, default=None)
    gap_geometry: GapGeometry = key("where the gap is measured", default="deformed")
    guide_bearing: BearingTable | None = None
    roller_bearing: BearingTable | None = None


class Product(Table):
    """The formed product."""

    height: float = positive("the height h0 of the product [m]", 0.01, 2, PRODUCTS)
    width: float = positive("the width B of the product, along the travel, [m]", 0.02, 20, PRODUCTS)
    mould_speed: Maybe = optional("the speed of the mould, across the travel, [m/s]", 2e-3, 0.1, MOULDS)


class Overrides(Table):
    """Parameters of the mix measured by the user, in place of the prior's; None: the prior's.

    Their plausible ranges follow from the prior, see `plausible_ranges`.
    """

    required_pressure: Maybe = optional("the pressure q that gives the density, [Pa]")
    plastic_modulus: Maybe = optional("the one-pass compaction modulus [Pa]")
    relaxed_modulus: Maybe = optional("the fully relaxed modulus [Pa]")
    unloading_modulus: Maybe = optional("the unloading modulus [Pa]")
    poisson: Maybe = or_zero("Poisson's ratio", lt=0.5)
    instant_over_relaxed: Maybe = key("the ratio of instant to relaxed modulus", ge=1, default=None)
    relaxation_time: Maybe = optional("the relaxation time [s]")
    pore_air_modulus: Maybe = optional("the modulus of the trapped air [Pa]")
    friction_angle: Maybe = or_zero("the angle of internal friction [deg]", le=60)
    cohesion: Maybe = or_zero("the cohesion [Pa]")
    steel_friction: Maybe = or_zero("the friction of mix on steel", le=1)
    heckel_slope: Maybe = optional("the one-dimensional Heckel slope K_H [1/Pa]")
    cohesion_loose: Maybe = or_zero("the cohesion of loose mix on the shear line [Pa]")
    earth_pressure_coefficient: Maybe = optional("the lateral over the vertical stress at the required pressure", lt=1)
    dilatancy_angle: Maybe = or_zero("the angle of dilatancy on the shear line [deg]", le=60)
    shear_viscosity: Maybe = or_zero("the stress per plastic shear strain over the travel [Pa m], 0 for none")
    saturation_limit: Maybe = key("the density ratio k that mix at rest does not exceed", gt=0.72, lt=1, default=None)
    rate_sensitivity: Maybe = or_zero("the rise m of the yield pressure over ln(rate), 0 for none", le=0.1)
    reference_rate: Maybe = optional("the rate of compaction [1/s] below which the Heckel slope is valid")
    effective_modulus: Maybe = optional("the secant contact modulus E of eqs 1.5, 1.6 [Pa]")
    air_permeability: Maybe = optional("the intrinsic permeability of the fed mix to air [m2]")
    occlusion_saturation: Maybe = optional("the saturation above which the air is occluded", le=1)


MixParameter = Literal[*Overrides.model_fields]  # type: ignore[valid-type]
_moisture = partial(key, "the moisture W as water mass / dry mass, 0.10 for 10 %", ge=0.08, le=0.12)


class FittedAt(Table):
    """Moisture and density ratio at which fitted values of the scene hold."""

    moisture: float = _moisture()
    density_ratio: float = key("the density ratio k of the product", ge=0.90, le=0.99)
    parameters: tuple[Fit, ...] = key("the fitted parameters", min_length=1)
    engine: EngineName | None = key("the engine by which the mix was fitted to forces", default=None)


class Mix(Table):
    """The mix behind the last pass; the bounds are those of the table of the prior."""

    moisture: float = _moisture()
    density_ratio: float = key("the required density ratio k of the product, 0.98 for 98 %", ge=0.90, le=0.99)
    law: MixLaw = key("the yield surface: an elliptic cap, or a cap with a shear line", default="ellipse")
    pore_air: PoreAirModel = key("the pore air: none, at drained deformation, or coupled", default="drained")
    overrides: Overrides = Overrides()
    fitted_at: FittedAt | None = None

    @property
    def values(self) -> dict[str, float]:
        """Overrides that are set, the fitted ones at the moisture and density ratio of the scene."""
        return self.overrides.model_dump(exclude_none=True) | self.scaled_fits

    @property
    def scaled_fits(self) -> dict[str, float]:
        """Fitted overrides that hold at another moisture or density ratio, scaled by the prior."""
        given = self.overrides.model_dump(exclude_none=True)
        fit = None if self.fitted_at is None else self.fitted_at.model_dump()
        return scaled_fits(self.moisture, self.density_ratio, given, fit)

    @property
    def fit_remark(self) -> str:
        """Sentence on fitted values at another moisture or density ratio; empty where they hold."""
        fit = self.fitted_at
        if fit is None or is_same_state((fit.moisture, fit.density_ratio), (self.moisture, self.density_ratio)):
            return ""
        kept = [name for name in fit.parameters if name not in CALIBRATED]
        words = [f"scaled by the prior: {', '.join(self.scaled_fits)}"] if self.scaled_fits else []
        words += [f"not scaled, as the prior lacks them: {', '.join(kept)}"] if kept else []
        place = f"fits hold at moisture {fit.moisture:g} and density ratio {fit.density_ratio:g}"
        return "; ".join([place, *words]) if words else ""


class Ply(Table):
    """One ply of the layer."""

    thickness: float = positive("the thickness [m]", 1e-3, 2, PRODUCTS)
    relative_modulus: float = positive("the moduli of the ply over those of the mix", 1e-3, 1e3, "stiff and soft plies")


class LowerLift(Table):
    """Lift of the same mix below the layer, compacted by an earlier pass and bonded to it, on the rigid base."""

    thickness: float = positive("the thickness [m]", 5e-3, 2, PRODUCTS)
    density_ratio: float = key("the density ratio k of the lift", **STATES)
    residual_stress: bool = key("true if the earlier pass has left its lateral stress, else false", default=True)


class Layer(Table):
    """The layer under the roller; homogeneous without `plies`."""

    base: BaseCondition = key("the condition at the base of the layer")
    lift_thickness: Maybe = optional("the compacted thickness of a lift [m]; default the product", 5e-3, 2, PRODUCTS)
    plies: tuple[Ply, ...] | None = key("the plies from the base upwards, as tables", min_length=1, default=None)
    lower_lift: LowerLift | None = None
    fed_density_ratio: float = key("the density ratio of the mix as fed", **STATES)
    passes: int = key("the number of passes", 1, 100, PASSES, ge=1, le=PASS_LIMIT)
    return_stroke: Literal["fresh", "compacted"] = key("the mix under the return stroke", default="fresh")


class Optimise(Table):
    """Optimal laws: each minimises one objective against the computed resistance, within bounds."""

    objectives: tuple[Objective, ...] = key("the objectives to minimise, one law for each", min_length=1)
    smoothness: int = key("the order up to which derivatives are continuous", ge=1, le=3)
    steady_tolerance: Maybe = or_zero("the deviation from the constant speed between the ramps, 0 for none", le=1)
    velocity: Maybe = optional("the largest velocity [m/s]", 1e-3, 10, MOTIONS)
    acceleration: Maybe = optional("the largest acceleration [m/s2]", 1e-3, 1e3, MOTIONS)
    jerk: Maybe = optional("the largest jerk [m/s3]", 1e-3, 1e5, MOTIONS)
    snap: Maybe = optional("the largest snap [m/s4]", 1e-3, 1e7, MOTIONS)
    pressure_angle: Maybe = optional("the largest pressure angle of the cam [rad]", 0.05, 1.57, CAMS, lt=1.57)
    radius_of_curvature: Maybe = or_zero("the least radius of curvature of a flat-faced cam [m]", 1e-3, 10, CAMS)
    spread: tuple[MixParameter, ...] = key(
        "the parameters of the mix over whose spread the regret is minimised", default=()
    )


class Motion(Table):
    """The travel of the cart, and the laws to compare; `laws` may be ["all"], see `Scene.law_names`."""

    stroke: float = positive("the travel between the two ends [m]", 0.02, 20, STROKES)
    duration: float = positive("the time of one pass [s]", 0.02, 600, STROKES)
    laws: tuple[Literal[Law, "all"], ...] = key('the laws to compare, or ["all"]', min_length=1)
    # each at most a half, so together at most the whole pass
    run_up: float = key("the share of the pass for the acceleration phase", ge=1e-6, le=0.5)
    run_down: float = key("the share of the pass for the deceleration phase", ge=1e-6, le=0.5)
    energy_weight: float = share("the weight of the speed term in the complex law")
    acceleration_weight: float = share("the weight of the acceleration term in the complex law")
    dwell: float = nonnegative("the dwell at each end [s]", 1e-3, 3600, STROKES)
    rod_length: Maybe = optional("the length of the connecting rod [m]", 0.02, 40, "rods of a stroke of up to 20 m")
    other_durations: tuple[float, ...] = key("further times of one pass [s], at which the laws are ranked", default=())
    tables: tuple[str, ...] = key("CSV files of own laws, relative to the scene file", default=())
    optimise: Optimise | None = None


class BeltTable(Table):
    """The flat belt between a motor and the gear of its shaft."""

    pulley_radius: float = positive("the radius of the motor's pulley [m]", 0.01, 2, "pulleys")
    stiffness: float = positive("the force [N] that would stretch the belt by its length, E A", 1e3, 1e8, BELTS)
    preload: float = positive("the tension of both runs at rest [N]", 1, 1e6, BELTS)
    friction: float = positive("the friction of belt on pulley, of a V-belt that of the wedge", 0.05, 2, BELTS, le=2)
    wrap: float = positive("the angle of wrap of the smaller pulley [rad]", 0.2, 6.3, BELTS, lt=6.283)


class Motor(Table):
    """Motor, gear and flywheel of a drive; one turn of the shaft is one cycle."""

    curve: Literal["kloss", "linear"] = key("the torque-speed curve")
    torque: float = positive("the breakdown torque (kloss) or the torque at rest (linear) [N m]", 0.01, 1e5, DRIVES)
    speed: float = positive("the synchronous speed (kloss) or that without load (linear) [rad/s]", 1, 2000, DRIVES)
    breakdown_slip: Maybe = optional("the slip at the breakdown torque", 0.01, 1, DRIVES, le=1)
    inertia: float = nonnegative("the inertia of the rotor [kg m2]", 1e-6, 1e3, DRIVES)
    gear_ratio: float = positive("the speed of the motor over that of the shaft, belt included", 0.01, 1e4, DRIVES)
    flywheel_inertia: float = nonnegative("the inertia of flywheel and shaft [kg m2]", 1e-5, 1e5, DRIVES)
    belt: BeltTable | None = None


class Hydraulics(Table):
    """Cylinders, throttles, pump and oil of a hydraulic drive."""

    piston_area: float = positive("the area of each piston [m2]", 1e-5, 1, OILS)
    supply_pressure: float = positive("the pressure of the relief valve [Pa]", 1e5, 1e8, OILS)
    pump_flow: float = positive("the flow of the pump [m3/s]", 1e-6, 0.1, OILS)
    valve_area: float = positive("the area of a throttle wide open [m2]", 1e-8, 0.01, OILS)
    discharge_coefficient: float = positive("the discharge coefficient of the throttles", 0.1, 1, OILS, le=1)
    oil_density: float = positive("the density of the oil [kg/m3]", 500, 2000, "oils, water and glycols")
    transition_drop: float = positive("the drop of pressure [Pa] below which a throttle is laminar", 1, 1e6, OILS)
    bulk_modulus: float = positive("the bulk modulus of the oil [Pa]", 1e8, 5e9, "oil with its air")
    dead_volume: float = positive("the volume of a cylinder with its line at its end, [m3]", 1e-7, 0.1, OILS)


class EndSpringTable(Table):
    """Springs at both ends of the stroke that reverse the cart."""

    stiffness: float = nonnegative("the stiffness of one spring [N/m]", 10, 1e9, SPRINGS)
    preload: float = nonnegative("the force of a spring at first contact [N]", 0.1, 1e6, SPRINGS)
    length: float = positive("the travel at each end over which a spring is compressed [m]", 1e-3, 5, SPRINGS)


class CatalogueTable(Table):
    """The motors from which the smallest that holds is chosen, and the rule by which it holds."""

    file: str | None = key("the CSV file of the motors; default motors by standard", default=None)
    margin: float = key("the factor of rms and peak torque that a motor must hold, 1 for none", ge=1, le=10)
    efficiency: float = positive("the efficiency of the gear between motor and shaft", 0.1, 1, DRIVES, le=1)
    gear_ratio: Maybe = optional("the speed of the motor over that of the shaft", 0.01, 1e4, DRIVES)
    inertia_ratio: Maybe = optional("the largest inertia of the carts over that of the rotor", 0.01, 1e3, DRIVES)


class Drive(Table):
    """Drive of the carts, and the criteria of the ranking."""

    kind: Annotated[DriveKind, *_or_installed(drives.DRIVES)] = key("the kind of drive")
    stiffness: Maybe = optional("the stiffness of an elastic drive [N/m]", 1e3, 1e10, "soft belts to short steel bars")
    damping: Maybe = or_zero("the damping of an elastic drive [N s/m], 0 for none", 1, 1e8, DRIVES)
    backlash: Maybe = or_zero("the backlash of an elastic drive [m]", 1e-6, 0.05, "play of couplings and gears")
    turn: Turn = key('the resistance after a turn: "build-up", "step", or rows of travel in m and share', default=None)
    carts: int = key("the number of carts on one shaft", ge=1, le=4)
    angles: tuple[float, ...] | None = key("the crank angle of each cart [rad]", 1e-3, 6.3, "one turn", default=None)
    motor: Motor | None = None
    hydraulics: Hydraulics | None = None
    end_springs: EndSpringTable | None = None
    catalogue: CatalogueTable | None = None
    rank_by: tuple[RankBy, ...] = key("the quantities to rank by", min_length=1)


class Cam(Table):
    """The cam of constant breadth."""

    breadth: float = positive("the constant breadth b of the cam [m]", 0.02, 10, CAMS)
    roller_follower_radius: float = positive("the radius of the roller followers [m]", 1e-3, 0.5, CAMS)
    bore: Maybe = optional("the diameter of the bore for the shaft [m]", 1e-3, 1, CAMS)


class Process(Table):
    """The forming process: strokes over a mould that moves along the axis of the rollers, with feed before each."""

    mould_speed: float = nonnegative("the speed of the mould along the roller [m/s], 0 at rest", 1e-4, 1, CREEPING)
    strokes: int | None = key("the strokes of a mould at rest", 1, 2000, SECTIONS, ge=1, le=STROKES_LIMIT, default=None)
    fill_height: Maybe = optional("the height of the mix in the mould before the first stroke [m]", 5e-3, 2, PRODUCTS)
    fill_density_ratio: Maybe = key("the density ratio of that mix", **STATES, default=None)
    feed_density_ratio: float = key("the density ratio of the mix as fed", **STATES)
    feed: FeedLaw = key("the distribution of the feed over the strokes", default="room")
    feed_count: int | None = key('the fed strokes of "first"', ge=1, le=STROKES_LIMIT, default=None)
    feeds: Literal["both", "forward"] = key("the strokes before which mix is fed", default="both")
    gap: Maybe = or_zero("the gap above the lowest generatrix up to which mix is fed [m]", 1e-5, 0.2, PART_OF_ROLLER)
    product_density_ratio: Maybe = key("the mean density ratio of the product", **STATES, default=None)
    extrusion_pressure: Maybe = optional("the pressure that the mix evades [Pa]", 1e3, 5e6, PRESSURES)
    offered_thickness: Maybe = or_zero("the thickness that a stroke offers [m]", 1e-5, 0.5, PART_OF_ROLLER)
    nip_angle: float = positive("the largest angle of entry [deg]", 1, 60, "mix on steel", default=NIP_ANGLE, le=60)
    largest_grain: Maybe = optional("the size of the largest grains [m]", 1e-4, 0.05, "sand to coarse aggregate")
    layers: int = key("the number of merged layers of a section", default=20, ge=1, le=500)
    kneading: Ends = key("gain and exponent of the Heckel slope", min_length=2, max_length=2, default=None)
    plate_length: Maybe = optional("the length of the smoothing plate along the roller [m]", 1e-3, 5, PART_OF_PRODUCT)
    plate_pressure: Maybe = or_zero("the pressure of the mix on it [Pa]", 10, 1e6, PRESSURES)
    measured_force: Maybe = optional("the force that moves a cart, measured or printed [N]", 1, 1e6, CARTS)
    measured_advances: Ends = key("advances a stroke in rows of a plant [m]", 1e-5, 1, CREEPING, default=None)
    measured_strokes: Ends = key("their strokes a minute [1/min]", 1, 300, CARTS, default=None)
    detail: ProcessDetail | None = key('columns, or lumped lifts; default "deep" for "process"', default=None)


class Sleeve(Table):
    """The feed sleeves, full of loose mix that the moving cart shears over the bed."""

    width: float = positive("the width along the travel [m]", 5e-3, 2, SLEEVES)
    head: float = positive("the height of the mix above the bed [m]", 0.01, 5, SLEEVES)
    wall_friction: float = share("the friction coefficient of the mix on the wall")
    count: int = key("the number of sleeves of one cart", 1, 20, SLEEVES, ge=1, le=COUNT_LIMIT)
    measured_drag: Maybe = or_zero("their drag on a cart, of a pull test [N]", 1, 1e5, CARTS)


class Contact(Table):
    """Prescribed quantity and speeds of the contact; default the pressure that the mix requires."""

    indentation: Maybe = optional(f"the depth below the undisturbed surface [m] {TOUCHES}", 1e-5, 0.5, PART_OF_PRODUCT)
    load: Maybe = optional(f"the normal force on one roller [N] {TOUCHES}", 10, 1e6, CARTS)
    peak_pressure: Maybe = optional(f"the largest contact pressure [Pa] {TOUCHES}", 1e3, 1e7, PRESSURES)
    held: HeldQuantity | None = key("the quantity held over speed; default the prescribed one", default=None)
    speeds: tuple[float, ...] | None = key("the speeds of the contacts [m/s]", 1e-4, 5, "rolling", default=None)


class Accuracy(Table):
    """Contact engine and its relative error tolerance."""

    tolerance: float = positive("the relative error tolerance, 0.01 for 1 %", 1e-5, 0.2, ERRORS, lt=0.5)
    engine: Annotated[EngineName, *_or_installed(ENGINES)] = key("the contact engine")


class Given(Table):
    """Keys that replace those of the scene for one engine of the comparison."""

    machine: dict[str, Any] | None = Field(None, description="keys of [machine]")
    mix: dict[str, Any] | None = Field(None, description="keys of [mix]")
    layer: dict[str, Any] | None = Field(None, description="keys of [layer]")
    contact: dict[str, Any] | None = Field(None, description="keys of [contact]")
    accuracy: dict[str, Any] | None = Field(None, description="keys of [accuracy]")
    process: dict[str, Any] | None = Field(None, description="keys of [process]")


class Compare(Table):
    """Engines of the comparison, one table each; the formulas are compared with every engine of a layer."""

    model_config = ConfigDict(extra="allow")  # tables of the engines of other packages
    __pydantic_extra__: dict[str, Given] = Field(init=False)

    formula: Given | None = None
    column: Given | None = None
    spectral: Given | None = None
    fem: Given | None = None
    compaction: Given | None = None
    process: Given | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_engines(cls, given: Any) -> Any:
        """Refuse tables of other names than those of engines."""
        known = {*cls.model_fields, *ENGINES.installed}
        unknown = [name for name in given if name not in known] if isinstance(given, dict) else []
        if unknown:
            found = [InitErrorDetails(type="extra_forbidden", loc=(name,), input=given[name]) for name in unknown]
            raise pydantic.ValidationError.from_exception_data(cls.__name__, found)
        return given


class Output(Table):
    """Items of the output; nothing else is computed."""

    items: tuple[OutputItem, ...] = key("the items to write, [] for the summary only")


class SceneTables(Table):
    """All tables of a scene, and the keys before the first of them."""

    title: str = key("a title in quotes", default="")
    unusual: tuple[str, ...] = key("keys whose values are meant as given, though implausible", default=())
    machine: Machine
    product: Product
    mix: Mix
    layer: Layer
    motion: Motion
    drive: Drive
    cam: Cam | None = None
    contact: Contact | None = None
    process: Process | None = None
    sleeve: Sleeve | None = None
    accuracy: Accuracy
    compare: Compare | None = None
    output: Output


def table_of(info: FieldInfo) -> type[Table] | None:
    """Return the class of the table, or of the tables in the list, of a field; None for a field with a value."""
    kinds = [info.annotation]
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, Table):
            return kind
        kinds += get_args(kind)
    return None


def declared_tables(table: type[Table] = SceneTables, path: tuple[str, ...] = ()) -> Iterator[tuple[Any, type[Table]]]:
    """Yield the key path of every table of a scene, () of the scene itself, with its class."""
    yield path, table
    for name, info in table.model_fields.items():
        if inner := table_of(info):
            yield from declared_tables(inner, (*path, name))


@cache
def declared_keys() -> dict[str, FieldInfo]:
    """Return the declaration of every key by its path, those of lists of tables too."""
    return {
        ".".join((*path, name)): info
        for path, table in declared_tables()
        for name, info in table.model_fields.items()
        if table_of(info) is None
    }


def extra_of(key: str) -> dict[str, Any]:
    """Return unit, plausible range ("plausible") and its reason ("why") of a key, where they are declared."""
    extra = declared_keys()[key].json_schema_extra
    return dict(extra) if isinstance(extra, dict) else {}


def unit_of(key: str) -> str:
    """Return the unit of a key behind a blank, as it follows a number; empty for a plain number."""
    unit = extra_of(key).get("unit", "1")
    return "" if unit == "1" else f" {unit}"
