"""The tables of a scene: every key with its type, its bounds and its meaning; SI units, no default for a number.

`machine.roller_condition` and `machine.gap_geometry` have defaults, which each engine may replace by the nearest value
that it accepts (`engine_capabilities`). A scene that sets them keeps its values or is refused.

Rules between the keys are in `constraints`; `loader` reads files into these tables and reports mistakes.
"""

from collections.abc import Callable
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, Strict, WrapValidator

from compact.material.mix import CALIBRATED, is_same_state, scaled_fits
from compact.rolling_contact import BaseCondition, GapGeometry, RollerCondition
from compact.scene.engine_capabilities import BUILT_IN, installed_engines

# The keys of `motion.LAWS`, repeated because importing `motion` costs 0.7 s of scipy; a test compares the two.
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
# The keys of `machine.ranking.CRITERIA`, repeated for the same reason
RankBy = Literal[
    "peak_force", "peak_power", "rms_force", "rms_power", "mean_force", "mean_power", "energy", "drawn_energy",
    "peak_jerk", "dynamic_factor", "nonuniformity", "dynamic_amplification",
]  # fmt: skip
Objective = Literal["peak_force", "peak_power", "rms_force", "energy", "drawn_energy"]
MixParameter = Literal[
    "required_pressure", "plastic_modulus", "relaxed_modulus", "unloading_modulus", "poisson", "instant_over_relaxed",
    "relaxation_time", "pore_air_modulus", "friction_angle", "cohesion", "steel_friction", "heckel_slope",
    "rate_sensitivity", "reference_rate", "effective_modulus", "air_permeability", "occlusion_saturation",
    "cohesion_loose", "earth_pressure_coefficient", "dilatancy_angle", "shear_viscosity",
]  # fmt: skip
Fit = Literal[  # mix.CALIBRATED, which the prior scales, and two that it does not know
    "required_pressure", "plastic_modulus", "relaxed_modulus", "heckel_slope", "effective_modulus",
    "fed_density_ratio", "roller_friction",
]  # fmt: skip
Engine = Literal["formula", "column", "spectral", "fem", "compaction", "process"]
MixLaw = Literal["ellipse", "drucker-prager-cap"]
PoreAirModel = Literal["drained", "one-way", "coupled"]
HeldQuantity = Literal["height", "load", "peak_pressure"]
ProcessDetail = Literal["columns", "quick", "deep"]
FeedLaw = Literal["room", "even", "first", "table"]
NIP_ANGLE = 20.0  # [deg], default of `process.nip_angle`
STROKES_LIMIT = 10_000  # [-], strokes on one section of a product
PASS_LIMIT = 1000  # [-], some seconds by columns, half an hour by finite elements; the mix changes in the first tens
COUNT_LIMIT = 1_000_000  # [-], beyond any machine; excludes typing errors such as 0xffff... from loops

# TOML has lists only, which are converted to tuples
Numbers = Annotated[tuple[float, ...], Strict(False)]
Laws = Annotated[tuple[Literal[Law, "all"], ...], Strict(False)]
Names = Annotated[tuple[str, ...], Strict(False)]
Ranks = Annotated[tuple[RankBy, ...], Strict(False)]
Objectives = Annotated[tuple[Objective, ...], Strict(False)]
Spreads = Annotated[tuple[MixParameter, ...], Strict(False)]
Fits = Annotated[tuple[Fit, ...], Strict(False)]
Outputs = Annotated[tuple[OutputItem, ...], Strict(False)]
Keys = dict[str, Any]


def _positive(meaning: str) -> Any:
    return Field(gt=0, description=meaning)


def _nonnegative(meaning: str) -> Any:
    return Field(ge=0, description=meaning)


def _between(low: float, high: float, meaning: str) -> Any:
    return Field(ge=low, le=high, description=meaning)


def _optional(meaning: str, **bounds: Any) -> Any:
    return Field(default=None, description=meaning, **(bounds or {"gt": 0}))


def _default(value: Any, meaning: str) -> Any:
    return Field(default=value, description=meaning)


class Table(BaseModel):
    """Base of all tables: immutable, strict types, finite numbers, no unknown keys."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


class BearingTable(Table):
    """The rolling bearings of one wheel or roller, which share its load."""

    dynamic_rating: float = _positive("the basic dynamic rating C of one bearing in N")
    kind: Literal["ball", "roller"] = Field(description="the rolling elements")
    count: int = _between(1, 1000, "the number of bearings that share the load")


class Machine(Table):
    """The cart, its rollers, guides and drive pin; positions are from the cart's centre, + towards the drive."""

    mass: float = _positive("the mass m of the cart in kg")
    weight: float = _positive("the weight G of the cart in N")  # apart from mass: the paper rounds g to 10
    rollers: int = _between(1, COUNT_LIMIT, "the number of rollers of one cart")
    roller_radius: float = _positive("the radius in m")
    roller_length: float = _positive("the length L of one roller, across the travel, in m")
    roller_positions: Numbers = Field(description="one position per roller in m, + towards the drive")
    guide_positions: Numbers = Field(
        min_length=2, max_length=2, description="the positions of the [front, rear] guide wheels in m"
    )
    pin_position: float = Field(description="the position of the drive pin in m, + towards the drive")
    pin_height: float = Field(description="the height of the drive pin above the roller axle in m")
    guide_wheel_diameter: float = _positive("the diameter D of the guide wheels in m")
    guide_friction: float = _between(0, 1, "the Coulomb coefficient at the guide wheels")
    journal_diameter: float = _positive("the journal diameter d of the guide wheels in m (eq 1.9)")
    bearing_friction: float = _between(0, 1, "the friction f3 of bush on journal (eqs 1.8, 1.9)")
    rolling_arm: float = _nonnegative("the rolling-friction arm f4 of the guide wheels in m (eq 1.9)")
    rib_factor: float = Field(ge=1, description="the factor f5 for rubbing of the wheel ribs, 1 for none (eq 1.9)")
    roller_friction: float = _between(0, 1, "the friction f2 of the roller (eq 1.8)")
    feeder_sleeve: float = _nonnegative("the width B_T of the feeder sleeve along the travel in m (eq 1.2)")
    overlap: float = _nonnegative("the overlap b_n of neighbouring rollers' strips in m (eqs 1.2, 1.3)")
    pressure_nonuniformity: float = _positive("the factor k2 for uneven pressure along the arc, 1 for even (eq 1.6)")
    one_sided: bool = Field(description="true for contact on the front half only (rival reading of eq 1.6), else false")
    roller_condition: RollerCondition = _default("free", "how the roller turns")
    roller_torque: float | None = _default(
        None, "the torque on one roller in N m, + driving it the way it travels, - braking it"
    )
    gap_geometry: GapGeometry = _default("deformed", "where the gap is measured")
    guide_bearing: BearingTable | None = None
    roller_bearing: BearingTable | None = None


class Product(Table):
    """The formed product."""

    height: float = _positive("the height h0 of the product in m")
    width: float = _positive("the width B of the product, along the travel, in m")
    mould_speed: float | None = _optional("the speed of the mould, across the travel, in m/s")


class Overrides(Table):
    """Parameters of the mix measured by the user, in place of the prior's; None: the prior's."""

    required_pressure: float | None = _optional("the pressure q that gives the density, in Pa")
    plastic_modulus: float | None = _optional("the one-pass compaction modulus in Pa")
    relaxed_modulus: float | None = _optional("the fully relaxed modulus in Pa")
    unloading_modulus: float | None = _optional("the unloading modulus in Pa")
    poisson: float | None = _optional("Poisson's ratio", ge=0, lt=0.5)
    instant_over_relaxed: float | None = _optional("the ratio of instant to relaxed modulus", ge=1)
    relaxation_time: float | None = _optional("the relaxation time in s")
    pore_air_modulus: float | None = _optional("the modulus of the trapped air in Pa")
    friction_angle: float | None = _optional("the angle of internal friction in degrees", ge=0, le=60)
    cohesion: float | None = _optional("the cohesion in Pa", ge=0)
    steel_friction: float | None = _optional("the friction of mix on steel", ge=0, le=1)
    heckel_slope: float | None = _optional("the one-dimensional Heckel slope K_H in 1/Pa")
    cohesion_loose: float | None = _optional("the cohesion of loose mix on the shear line in Pa", ge=0)
    earth_pressure_coefficient: float | None = _optional(
        "the lateral over the vertical stress of confined compression at the required pressure", gt=0, lt=1
    )
    dilatancy_angle: float | None = _optional("the angle of dilatancy on the shear line in degrees", ge=0, le=60)
    shear_viscosity: float | None = _optional(
        "the stress beyond the shear line per plastic shear strain over the travel in Pa m, 0 for none", ge=0
    )
    rate_sensitivity: float | None = _optional(
        "the increase m of the yield pressure over ln(rate of compaction), 0 for none", ge=0, le=0.1
    )
    reference_rate: float | None = _optional("the rate of compaction in 1/s below which the Heckel slope is valid")
    effective_modulus: float | None = _optional("the secant contact modulus E of eqs 1.5, 1.6 in Pa")
    air_permeability: float | None = _optional("the intrinsic permeability of the fed mix to air in m2")
    occlusion_saturation: float | None = _optional("the saturation above which the air is occluded", gt=0, le=1)


class FittedAt(Table):
    """Moisture and density ratio at which fitted values of the scene hold."""

    moisture: float = _between(0.08, 0.12, "the moisture W as water mass / dry mass, 0.10 for 10 %")
    density_ratio: float = _between(0.90, 0.99, "the density ratio k of the product")
    parameters: Fits = Field(min_length=1, description="the fitted parameters")


class Mix(Table):
    """The mix behind the last pass; the bounds are those of the table of the prior."""

    moisture: float = _between(0.08, 0.12, "the moisture W as water mass / dry mass, 0.10 for 10 %")
    density_ratio: float = _between(0.90, 0.99, "the required density ratio k of the product")
    law: MixLaw = _default(
        "ellipse",
        "the yield surface of the engines that compact: an elliptic cap, or a cap with a shear line",
    )
    pore_air: PoreAirModel = _default(
        "drained", "the pore air: without pressure, at the deformation without air, or coupled with the deformation"
    )
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

    thickness: float = _positive("the thickness in m")
    relative_modulus: float = _positive("the moduli of the ply over those of the mix")


class LowerLift(Table):
    """Lift of the same mix below the layer, compacted by an earlier pass and bonded to it, on the rigid base."""

    thickness: float = _positive("the thickness in m")
    density_ratio: float = Field(gt=0.72, le=0.99, description="the density ratio k of the lift")
    residual_stress: bool = _default(True, "true if the earlier pass has left its lateral stress, false for no stress")


Plies = Annotated[tuple[Ply, ...], Strict(False)]


class Layer(Table):
    """The layer under the roller; homogeneous without `plies`."""

    base: BaseCondition = Field(description="the condition at the base of the layer")
    lift_thickness: float | None = _optional(
        "the compacted thickness of one lift in m; default the height of the product"
    )
    plies: Plies | None = Field(default=None, min_length=1, description="the plies from the base upwards, as tables")
    lower_lift: LowerLift | None = None
    fed_density_ratio: float = Field(gt=0.72, le=0.99, description="the density ratio of the mix as fed")
    passes: int = _between(1, PASS_LIMIT, "the number of passes")
    return_stroke: Literal["fresh", "compacted"] = Field(
        default="fresh", description="the mix under the return stroke: fresh as on the way out, or compacted by it"
    )


class Optimise(Table):
    """Optimal laws: each minimises one objective against the computed resistance, within bounds."""

    objectives: Objectives = Field(min_length=1, description="the objectives to minimise, one law for each")
    smoothness: int = _between(1, 3, "the order up to which derivatives are continuous")
    steady_tolerance: float | None = _optional(
        "the deviation allowed from the constant speed between run-up and run-down, 0 for none", ge=0, le=1
    )
    velocity: float | None = _optional("the largest velocity in m/s")
    acceleration: float | None = _optional("the largest acceleration in m/s2")
    jerk: float | None = _optional("the largest jerk in m/s3")
    snap: float | None = _optional("the largest snap in m/s4")
    pressure_angle: float | None = _optional("the largest pressure angle of the cam in rad", gt=0, lt=1.57)
    radius_of_curvature: float | None = _optional("the least radius of curvature of a flat-faced cam in m", ge=0)
    profile_radius: float | None = _optional(
        "the least radius of curvature of the profile of a cam for rollers in m, convex or hollow; 0 for no undercut",
        ge=0,
    )
    spread: Spreads = _default((), "the parameters of the mix over whose spread the regret is minimised")


class Motion(Table):
    """The travel of the cart, and the laws to compare; `laws` may be ["all"], see `Scene.law_names`."""

    stroke: float = _positive("the travel between the two ends in m")
    duration: float = _positive("the time of one pass in s")
    laws: Laws = Field(min_length=1, description='the laws to compare, or ["all"]')
    # each at most a half, so together at most the whole pass
    run_up: float = Field(ge=1e-6, le=0.5, description="the share of the pass for the acceleration phase")
    run_down: float = Field(ge=1e-6, le=0.5, description="the share of the pass for the deceleration phase")
    energy_weight: float = _nonnegative("the weight of the speed term in the complex law")
    acceleration_weight: float = _nonnegative("the weight of the acceleration term in the complex law")
    dwell: float = _nonnegative("the dwell at each end in s")
    rod_length: float | None = _optional("the length of the connecting rod in m")
    other_durations: Numbers = _default((), "further times of one pass in s, over which the laws are ranked as well")
    tables: Names = _default((), "CSV files of own laws, relative to the scene file")
    optimise: Optimise | None = None


class BeltTable(Table):
    """The flat belt between a motor and the gear of its shaft."""

    pulley_radius: float = _positive("the radius of the motor's pulley in m")
    stiffness: float = _positive("the force in N that would stretch the belt by its length, E A")
    preload: float = _positive("the tension of both runs at rest in N")
    friction: float = Field(gt=0, le=2, description="the friction of belt on pulley, of a V-belt that of the wedge")
    wrap: float = Field(gt=0, lt=6.283, description="the angle of wrap of the smaller pulley in rad")


class Motor(Table):
    """Motor, gear and flywheel of a drive; one turn of the shaft is one cycle."""

    curve: Literal["kloss", "linear"] = Field(description="the torque-speed curve")
    torque: float = _positive("the breakdown torque (kloss) or the torque at rest (linear) in N m")
    speed: float = _positive("the synchronous speed (kloss) or that without load (linear) in rad/s")
    breakdown_slip: float | None = _optional("the slip at the breakdown torque", gt=0, le=1)
    inertia: float = _nonnegative("the inertia of the rotor in kg m2")
    gear_ratio: float = _positive("the speed of the motor over that of the shaft, pulleys of a belt included")
    flywheel_inertia: float = _nonnegative("the inertia of flywheel and shaft in kg m2")
    belt: BeltTable | None = None


class Hydraulics(Table):
    """Cylinders, throttles, pump and oil of a hydraulic drive."""

    piston_area: float = _positive("the area of each piston in m2")
    supply_pressure: float = _positive("the pressure of the relief valve in Pa")
    pump_flow: float = _positive("the flow of the pump in m3/s")
    valve_area: float = _positive("the area of a throttle wide open in m2")
    discharge_coefficient: float = Field(gt=0, le=1, description="the discharge coefficient of the throttles")
    oil_density: float = _positive("the density of the oil in kg/m3")
    transition_drop: float = _positive("the drop of pressure in Pa below which a throttle is laminar")
    bulk_modulus: float = _positive("the bulk modulus of the oil in Pa")
    dead_volume: float = _positive("the volume of a cylinder with its line, the piston at its end, in m3")


class EndSpringTable(Table):
    """Springs at both ends of the stroke that reverse the cart."""

    stiffness: float = _nonnegative("the stiffness of one spring in N/m")
    preload: float = _nonnegative("the force of a spring at first contact in N")
    length: float = _positive("the travel at each end over which a spring is compressed in m")


class CatalogueTable(Table):
    """The motors from which the smallest that holds is chosen, and the rule by which it holds."""

    file: str = Field(description="the CSV file of the motors, relative to the scene file")
    margin: float = _between(1, 10, "the factor of rms and peak torque that a motor must hold, 1 for none")
    efficiency: float = Field(gt=0, le=1, description="the efficiency of the gear between motor and shaft")
    gear_ratio: float | None = _optional("the speed of the motor over that of the shaft")
    inertia_ratio: float | None = _optional("the largest inertia of the carts over that of the rotor, at the motor")


class Drive(Table):
    """Drive of the carts, and the criteria of the ranking."""

    kind: Literal["rigid", "crank", "elastic", "motor", "hydraulic"] = Field(description="the kind of drive")
    stiffness: float | None = _optional("the stiffness of an elastic drive in N/m")
    damping: float | None = _optional("the damping of an elastic drive in N s/m, 0 for none", ge=0)
    backlash: float | None = _optional("the backlash of an elastic drive in m", ge=0)
    include_added_mass: bool | None = _default(
        None, "true if the resistance of an elastic drive includes the added mass, F + a M, else false"
    )
    carts: int = _between(1, 4, "the number of carts on one shaft")
    angles: Numbers | None = _default(None, "the crank angle of each cart in rad")
    motor: Motor | None = None
    hydraulics: Hydraulics | None = None
    end_springs: EndSpringTable | None = None
    catalogue: CatalogueTable | None = None
    rank_by: Ranks = Field(min_length=1, description="the quantities to rank by")


class Cam(Table):
    """The cam of constant breadth."""

    breadth: float = _positive("the constant breadth b of the cam in m")
    roller_follower_radius: float = _positive("the radius of the roller followers in m")
    bore: float | None = _optional("the diameter of the bore for the shaft in m")


class FeedPoint(Table):
    """One point of the table of the feed along the roller."""

    position: float = _nonnegative("the position along the roller from the empty mould in m")
    relative_thickness: float = _nonnegative("the thickness of the fed mix over that of the other points")


FeedPoints = Annotated[tuple[FeedPoint, ...], Strict(False)]


class Process(Table):
    """The forming process: strokes over a mould that moves along the axis of the rollers, with feed before each."""

    mould_speed: float = _nonnegative("the speed of the mould along the axis of the rollers in m/s, 0 at rest")
    strokes: int | None = _optional("the number of strokes of a mould at rest", ge=1, le=STROKES_LIMIT)
    fill_height: float | None = _optional("the height of the loose mix in the mould before the first stroke in m")
    fill_density_ratio: float | None = _optional("the density ratio of that mix", gt=0.72, le=0.99)
    feed_density_ratio: float = Field(gt=0.72, le=0.99, description="the density ratio of the mix as fed")
    feed: FeedLaw = _default("room", "the distribution of the feed over the strokes")
    feed_count: int | None = _optional('the number of fed strokes of the feed "first"', ge=1, le=STROKES_LIMIT)
    feed_table: FeedPoints | None = Field(default=None, min_length=1, description='the points of the feed "table"')
    feeds: Literal["both", "forward"] = _default("both", "the strokes before which mix is fed")
    gap: float | None = _optional("the gap above the lowest generatrix up to which mix is fed in m", ge=0)
    product_density_ratio: float | None = _optional("the mean density ratio of the product", gt=0.72, le=0.99)
    extrusion_pressure: float | None = _optional("the pressure under the roller that mix evades in Pa")
    offered_thickness: float | None = _optional("the thickness that the sleeves offer in a stroke in m", ge=0)
    nip_angle: float = Field(
        default=NIP_ANGLE, gt=0, le=60, description="the largest angle at which a roller draws mix in, in degrees"
    )
    largest_grain: float | None = _optional("the size of the largest grains in m")
    layers: int = Field(default=20, ge=1, le=500, description="the number of merged layers of a section")
    detail: ProcessDetail | None = _default(
        None, 'the model: columns, or lumped lifts in two dimensions; default "quick" for the engine "process"'
    )


class Sleeve(Table):
    """The feed sleeves, full of loose mix that the moving cart shears over the bed."""

    width: float = _positive("the width along the travel in m")
    head: float = _positive("the height of the mix above the bed in m")
    wall_friction: float = _between(0, 1, "the friction coefficient of the mix on the wall")
    count: int = _between(1, COUNT_LIMIT, "the number of sleeves of one cart")


TOUCHES = "(zero means no contact)"


class Contact(Table):
    """Prescribed quantity and speeds of the contact; default the pressure that the mix requires."""

    indentation: float | None = _optional(f"the depth of the roller below the undisturbed surface in m {TOUCHES}")
    load: float | None = _optional(f"the normal force on one roller in N {TOUCHES}")
    peak_pressure: float | None = _optional(f"the largest contact pressure in Pa {TOUCHES}")
    held: HeldQuantity | None = _default(
        None,
        "the quantity held constant over speed; default a prescribed load or peak pressure, else the height of the "
        "roller",
    )
    speeds: Numbers | None = _default(None, "the speeds of the computed contacts in m/s")


def _installed_engine(value: Any, validate: Callable[[Any], Any]) -> Any:
    """Accept the engines of other packages as well."""
    return (
        value if isinstance(value, str) and value not in BUILT_IN and value in installed_engines() else validate(value)
    )


class Accuracy(Table):
    """Contact engine and its relative error tolerance."""

    tolerance: float = Field(gt=0, lt=0.5, description="the relative error tolerance, 0.01 for 1 %")
    engine: Annotated[Engine, WrapValidator(_installed_engine), PlainSerializer(str, str)] = Field(
        description="the contact engine"
    )


class Given(Table):
    """Keys that replace those of the scene for one engine of the comparison."""

    machine: Keys | None = _default(None, "keys of [machine]")
    mix: Keys | None = _default(None, "keys of [mix]")
    layer: Keys | None = _default(None, "keys of [layer]")
    contact: Keys | None = _default(None, "keys of [contact]")
    accuracy: Keys | None = _default(None, "keys of [accuracy]")
    process: Keys | None = _default(None, "keys of [process]")


class Compare(Table):
    """Engines of the comparison, one table each; the formulas are compared with every engine of a layer."""

    formula: Given | None = None
    column: Given | None = None
    spectral: Given | None = None
    fem: Given | None = None
    compaction: Given | None = None
    process: Given | None = None


class Output(Table):
    """Items of the output; nothing else is computed."""

    items: Outputs = Field(description="the items to write, [] for the summary only")
