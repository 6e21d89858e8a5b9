"""Words, lists and largest counts that keys of a scene take; `schema` declares the keys.

Words of other packages are repeated where their import would cost seconds; tests compare the two.
"""

from typing import Annotated, Any, Literal, get_args

from pydantic import Strict

# The keys of `motion.LAWS`
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
# The keys of `machine.ranking.CRITERIA`
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
DriveKind = Literal["rigid", "crank", "elastic", "motor", "hydraulic"]
MixLaw = Literal["ellipse", "drucker-prager-cap"]
PoreAirModel = Literal["drained", "one-way", "coupled"]
HeldQuantity = Literal["height", "load", "peak_pressure"]
ProcessDetail = Literal["columns", "quick", "deep"]
FeedLaw = Literal["room", "even", "first", "table"]

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

# Default and largest counts
NIP_ANGLE = 20.0  # [deg], default of `process.nip_angle`
STROKES_LIMIT = 10_000  # [-], strokes on one section of a product
PASS_LIMIT = 1000  # [-], some seconds by columns, half an hour by finite elements; the mix changes in the first tens
COUNT_LIMIT = 1_000_000  # [-], beyond any machine; excludes typing errors such as 0xffff... from loops
