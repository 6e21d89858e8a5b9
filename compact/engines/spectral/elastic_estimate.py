"""Elastic frictionless contact under a parabola, solved with few modes: an estimate for meshes and initial guesses.

    p = (E* a/2R) sum b_k sqrt(1 - xi^2) Q_{k-1}(xi),  u' = -x/R  on |x| <= a,  xi = x/a

with the polynomials of `jacobi_basis`. The error is 1e-3, and a few percent if the contact is many times as wide as the
top ply is thick.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from compact.engines.spectral.galerkin_system import assemble_system
from compact.engines.spectral.jacobi_basis import pressure_polynomials
from compact.engines.spectral.layer_compliance import LayerResponse, creep_compliance
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import Layer, Roller

ESTIMATE_MODES = 12  # [-], pressure polynomials
ESTIMATE_SAMPLES = 65  # [-], of the pressure, from the middle to an edge
ESTIMATE_TOLERANCE = 1e-6  # [-], relative residual of the target
ESTIMATE_STEPS_MAX = 60  # [-], of the secant method
LOG_STEP_MAX = 1.0  # [-], largest step of the logarithm of the half-width
HALF_WIDTH_SHARE_MIN = 1e-12  # [-], over the height; below it the contact is narrower than an atom
WIDTH_RATIO = 1.2  # [-], of the half-widths that share a mesh where the indentation is not prescribed
WIDTH_ITERATIONS = 4  # [-], fixed-point iterations for the modulus at the frequency of the contact
INITIAL_WIDTH_MAX = 2.0  # [-], initial half-width over the top ply, since wide contacts cost more modes


@dataclass(frozen=True)
class ElasticEstimate:
    """Elastic contact.

    Parameters
    ----------
    half_width, indentation : float
        Half-width a and indentation [m].
    load, peak_pressure : float
        Load per unit roller length [N/m] and peak pressure [Pa].
    """

    half_width: float
    indentation: float
    load: float
    peak_pressure: float


@lru_cache(maxsize=256)
def estimate_contact(layer: Layer, material: Elastic, radius: float, target: str, value: float) -> ElasticEstimate:
    """Estimate the contact for a prescribed quantity.

    Parameters
    ----------
    layer : Layer
        Layer.
    material : Elastic
        Constitutive law.
    radius : float
        Radius of the roller [m].
    target : {"indentation", "load", "peak_pressure"}
        Prescribed quantity.
    value : float
        Its value [m], [N/m] or [Pa].

    Returns
    -------
    ElasticEstimate

    Raises
    ------
    RuntimeError
        If no contact has the prescribed value.
    """
    log_a = np.log(initial_half_width(layer, material, radius, target, value))
    power, step, residual = 2.0, 0.0, 0.0
    for _ in range(ESTIMATE_STEPS_MAX):
        contact = contact_of_half_width(layer, material, radius, float(np.exp(log_a)))
        previous, residual = residual, np.log(getattr(contact, target) / value)
        if abs(residual) < ESTIMATE_TOLERANCE:
            return contact
        if step:
            power = np.clip((residual - previous) / step, 0.5, 20)
        step = np.clip(-residual / power, -LOG_STEP_MAX, LOG_STEP_MAX)
        log_a += step
    raise RuntimeError(
        f"no elastic contact with `{target}` {value!r} on {layer}, relative residual {residual:.1g}; change the target"
    )


def contact_of_half_width(layer: Layer, material: Elastic, radius: float, half_width: float) -> ElasticEstimate:
    """Compute the contact of a half-width.

    Parameters
    ----------
    layer : Layer
        Layer.
    material : Elastic
        Constitutive law.
    radius : float
        Radius of the roller [m].
    half_width : float
        Half-width of the contact [m].

    Returns
    -------
    ElasticEstimate
    """
    a, modulus = half_width, surface_modulus(layer, material)
    response = LayerResponse(layer, material.poisson, 0.0, creep_compliance((), 1.0, layer.height))
    system = assemble_system(response, ESTIMATE_MODES, a)
    basis, scale = system.basis, modulus * a / (2 * radius)
    b = np.linalg.solve(system.matrix[1:], basis.tests[1:] @ basis.nodes)
    depth = system.depths @ b + basis.tests[0] @ basis.nodes**2 / 2
    xi = np.linspace(0, 1, ESTIMATE_SAMPLES)
    pressure = np.sqrt(1 - xi**2) * (b @ pressure_polynomials(xi, basis.trailing_exponent, ESTIMATE_MODES))
    return ElasticEstimate(
        half_width=a,
        indentation=float(a**2 / radius * depth / basis.tests[0].sum()),
        load=float(scale * a * basis.unit_load * b[0]),
        peak_pressure=float(scale * pressure.max()),
    )


def expected_half_width(layer: Layer, roller: Roller, material: Elastic, speed: float) -> float:
    """Estimate the half-width [m] of a rolling contact.

    It is that of the relaxed modulus if the indentation is prescribed, else that of the modulus at the frequency
    speed/half-width, quantised.
    """

    def elastic(modulus: float) -> float:
        mix = Elastic(modulus, material.poisson)
        return estimate_contact(layer, mix, roller.radius, *roller.target).half_width

    half_width = relaxed = elastic(material.youngs_modulus)
    if roller.indentation is not None or not isinstance(material, Viscoelastic) or not material.branches:
        return relaxed
    for _ in range(WIDTH_ITERATIONS):
        half_width = elastic(float(abs(material.complex_modulus(speed / half_width))))
    return quantise_half_width(half_width, relaxed)


def quantise_half_width(half_width: float, widest: float) -> float:
    """Round a half-width [m] up to the widest over a power of WIDTH_RATIO, so that several speeds share a mesh."""
    return float(widest / WIDTH_RATIO ** np.floor(np.log(widest / half_width) / np.log(WIDTH_RATIO)))


def initial_half_width(layer: Layer, material: Elastic, radius: float, target: str, value: float) -> float:
    """Return a first guess of the half-width, by Hertz or as sqrt(R delta), at most two top plies.

    Parameters
    ----------
    layer : Layer
        Layer.
    material : Elastic
        Constitutive law.
    radius : float
        Radius of the roller [m].
    target : str
        Prescribed quantity, as of `estimate_contact`.
    value : float
        Its value [m], [N/m] or [Pa].

    Returns
    -------
    float
        Half-width [m].
    """
    modulus = surface_modulus(layer, material)
    half_width = {
        "indentation": lambda depth: np.sqrt(radius * depth),
        "load": lambda load: np.sqrt(4 * load * radius / (np.pi * modulus)),
        "peak_pressure": lambda pressure: 2 * radius * pressure / modulus,
    }[target](value)
    if half_width < HALF_WIDTH_SHARE_MIN * layer.height:
        raise RuntimeError(
            f"the roller does not touch the layer: `{target}` {value!r} makes a contact of {half_width:.1g} m; raise it"
        )
    return min(half_width, INITIAL_WIDTH_MAX * layer.top.thickness)


def surface_modulus(layer: Layer, material: Elastic) -> float:
    """Return the relaxed contact modulus E* of the top ply [Pa] for a layer and its material."""
    return material.contact_modulus * layer.top.stiffness
