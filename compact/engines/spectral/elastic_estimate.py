"""What to expect of a contact: that of an elastic layer without friction under a parabola, by a few polynomials.

    p = (E* a/2R) sum b_k sqrt(1 - xi^2) Q_{k-1}(xi),  u' = -x/R  on |x| <= a,  xi = x/a

in the words of `kernel`. Good to a per mille, to a few percent where the contact is many times as wide as the top ply
is thick: enough to choose a mesh and a first depth.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from compact.engines.spectral import galerkin_system
from compact.material.laws import Elastic

MODES = 12
SAMPLES = 65  # of the pressure, from the middle to an edge
NEAR = 1e-6  # relative distance to the target
STEPS = 60
AT_ONCE = 1.0  # farthest step of the log of the half-width
NOTHING = 1e-12  # layer heights: atoms are wider than such a contact
WIDTH_STEP = 1.2  # contacts that differ by less in width share a mesh where the indentation is not prescribed
WIDTHS = 4  # tried in turn for the modulus that such a contact meets
NARROW = 2.0  # top plies to either side at first, since a contact much wider than a ply costs more to try


@dataclass(frozen=True)
class ElasticEstimate:
    """Half-width a, indentation [m], load [N/m] and peak pressure [Pa] of an elastic contact."""

    half_width: float
    indentation: float
    load: float
    peak_pressure: float


@lru_cache(maxsize=256)
def elastic_estimate(layer, material, radius, target, value):
    """The `ElasticEstimate` contact with a given "indentation", "load" or "peak_pressure".

    material : Elastic;  radius : of the roller [m];  value : of the target, in its unit

    Raises RuntimeError where it is not found.
    """
    log, power, step, miss = np.log(first_half_width(layer, material, radius, target, value)), 2.0, 0.0, 0.0
    for _ in range(STEPS):
        contact = as_wide(layer, material, radius, float(np.exp(log)))
        before, miss = miss, np.log(getattr(contact, target) / value)
        if abs(miss) < NEAR:
            return contact
        if step:
            power = np.clip((miss - before) / step, 0.5, 20)
        step = np.clip(-miss / power, -AT_ONCE, AT_ONCE)
        log += step
    raise RuntimeError(f"no elastic contact with `{target}` {value!r} on {layer}: off by {miss:.1g} of itself")


def as_wide(layer, material, radius, half_width):
    """The `ElasticEstimate` contact with a given half-width a [m]."""
    a, modulus = half_width, surface_modulus(layer, material)
    system = galerkin_system.system(
        galerkin_system.LayerResponse(layer, material.poisson, 0.0, galerkin_system.creep((), 1.0, layer.height)),
        MODES,
        a,
    )
    basis, scale = system.basis, modulus * a / (2 * radius)
    b = np.linalg.solve(system.rows[1:], basis.tests[1:] @ basis.nodes)
    sinking = system.depths @ b + basis.tests[0] @ basis.nodes**2 / 2
    xi = np.linspace(0, 1, SAMPLES)
    pressure = np.sqrt(1 - xi**2) * (b @ galerkin_system.pressure_polynomials(xi, basis.trailing_exponent, MODES))
    return ElasticEstimate(
        half_width=a,
        indentation=float(a**2 / radius * sinking / basis.tests[0].sum()),
        load=float(scale * a * basis.unit_load * b[0]),
        peak_pressure=float(scale * pressure.max()),
    )


def half_width_met(layer, roller, material, speed):
    """Half-width [m] of the contact with the relaxed modulus, or with the one met at that width and speed [m/s] where
    the indentation is not prescribed."""

    def elastic(modulus):
        return elastic_estimate(layer, Elastic(modulus, material.poisson), roller.radius, *roller.target).half_width

    half_width = relaxed = elastic(material.youngs_modulus)
    if roller.indentation is not None or not getattr(material, "branches", ()):
        return relaxed
    for _ in range(WIDTHS):
        half_width = elastic(float(abs(material.complex_modulus(speed / half_width))))
    return shared_half_width(half_width, relaxed)


def shared_half_width(half_width, widest):
    """A half-width not much larger, one of few below the widest, for speeds to share the mesh made for it."""
    return float(widest / WIDTH_STEP ** np.floor(np.log(widest / half_width) / np.log(WIDTH_STEP)))


def first_half_width(layer, material, radius, target, value):
    """Half-width [m] of Hertz with the modulus of the surface, or sqrt(R delta), but narrow at first."""
    modulus = surface_modulus(layer, material)
    wide = {
        "indentation": lambda depth: np.sqrt(radius * depth),
        "load": lambda load: np.sqrt(4 * load * radius / (np.pi * modulus)),
        "peak_pressure": lambda pressure: 2 * radius * pressure / modulus,
    }[target](value)
    if wide < NOTHING * layer.height:
        raise RuntimeError(f"the roller does not touch the layer: `{target}` {value!r} makes a contact of {wide:.1g} m")
    return min(wide, NARROW * layer.top.thickness)


def surface_modulus(layer, material):
    """E* of the top ply, relaxed [Pa]."""
    return material.contact_modulus * layer.top.stiffness
