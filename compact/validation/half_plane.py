"""Case of a relaxing half-plane: the output of the program CONTACT for two cylinders of PA6, and the resistance.

Two like bodies in contact are one half-plane of half the stiffness under a rigid roller,

    E* = E/(1 - nu^2),  E = 2 (G/2)(1 + nu)

with the shear modulus G of each body and the combined radius. A body with the creep time T under constant stress and
moduli G, 2 G has the relaxation time T/2. The half-plane is a layer of many contact lengths. The layer must also be
thick over the travel within one relaxation time, 0.45 m at 100 m/s: one of 10 m has 0.2 % less resistance there, and
6 % less at 1000 m/s.
"""

import numpy as np

from compact.engines.fem import engine as fem
from compact.engines.spectral import engine as spectral
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import Contact, Layer, Roller
from compact.validation.case import Computed, Panel, Rows, ours, theirs

SHEAR_MODULUS, POISSON = 1143e6, 0.4  # [Pa], of each body at first; [-]
RADIUS, LOAD, SPEED = 0.05, 600e3, 1.0  # [m], combined; [N/m]; [m/s]
LAYER_HEIGHT = {"spectral": 1e4, "fem": 100.0}  # [m]
SERIES_CREEP_TIME = 0.009  # [s], of the resistance over speed
FIGURE_SPEEDS = np.geomspace(1e-3, 100.0, 41)  # [m/s]


def _roll(engine: str, creep_time: float, speed: float, *, relaxes: bool = True) -> Contact:
    """Compute one contact of the relaxing half-plane; without a creep time it is elastic."""
    shear_modulus = SHEAR_MODULUS / 2
    if relaxes:
        shear_modulus /= 2  # two like springs in series with the dashpot
    elastic = Elastic(youngs_modulus=2 * shear_modulus * (1 + POISSON), poisson=POISSON)
    material = Viscoelastic(**vars(elastic), branches=((1.0, creep_time / 2),)) if creep_time else elastic
    layer, roller = Layer(LAYER_HEIGHT[engine]), Roller(RADIUS, load=LOAD)
    if engine == "fem":
        return fem.roll(layer, roller, material, speed, estimate=False)
    return spectral.roll(layer, roller, material, speed)


def _resistance(engine: str, speed: float) -> float:
    """Compute resistance over load [-] at a speed [m/s]."""
    found = _roll(engine, SERIES_CREEP_TIME, speed)
    return float(found.resistance / found.load)


def relaxing_half_plane(rows: Rows) -> Computed:
    """Compute peak pressures, contact lengths and the resistance over speed."""
    values: dict[str, float] = {}
    series: dict[str, list[tuple[float, float, float]]] = {"spectral": [], "fem": []}
    for key in rows:
        name, _, quantity = key.rpartition("_")
        if name in series:
            values[key] = _resistance(name, float(quantity))
            series[name].append((float(quantity), values[key], rows[key].theirs))
        elif quantity == "peak":
            creep_time = 0.0 if name == "elastic" else float(name.removeprefix("creep_"))
            found = _roll("spectral", creep_time, SPEED, relaxes=name != "elastic")
            values |= {key: found.peak_pressure / 1e6, f"{name}_length": 1e3 * (found.leading - found.trailing)}
    speeds, by_fem, expected = np.array(series["fem"]).T
    curves = (
        ours("spectral", FIGURE_SPEEDS, [_resistance("spectral", speed) for speed in FIGURE_SPEEDS.tolist()]),
        ours("fem", speeds, by_fem),
        theirs("collocation", speeds, expected),
    )
    return values, [Panel("speed [m/s]", "resistance over load [-]", curves, log_x=True)]
