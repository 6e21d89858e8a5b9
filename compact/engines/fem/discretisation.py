"""Mesh and number of pressure terms for a contact whose size is estimated beforehand.

The first discretisation fits the elastic contact, so that all speeds at one indentation share a mesh and its factorised
stiffness. Retardation times that are short compared with the passage of the roller produce boundary layers at the edges
of the contact. Refined discretisations centre a mesh, finer at the edges, on the contact found last.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from compact.engines.fem.contact_patch import INITIAL_TERMS
from compact.engines.fem.contact_problem import Discretisation, RollingProblem, solve_contact
from compact.engines.spectral import elastic_estimate
from compact.engines.spectral import engine as spectral
from compact.engines.spectral.engine import SpectralContactResult
from compact.mesh import EDGE_REFINEMENT, RowMesh, elements_for, graded_mesh, mesh_for_error
from compact.rolling_contact import Layer

if TYPE_CHECKING:
    from compact.engines.fem.engine import FemContactResult

MIN_HALF_WIDTH = 1e-7  # [-], of a contact over the layer height, that a mesh of the layer can resolve
BASE_TERMS = 12  # [-], of the pressure; more resolve thinner boundary layers, but blur the edges beyond the mesh
TERMS_PER_WIDTH = 0.5  # [-], per half-width over the top ply, within whose thickness the pressure of a thin ply falls
MAX_TERMS = 30  # [-], of the first discretisation
ROUGH_TOLERANCE = 1e-2  # [-], of a prescribed load or peak pressure in the contact for which a mesh is chosen
MAX_LEVEL = 4  # [-], of refinement where the estimated error exceeds the tolerance; the first mesh has level 0
ELEMENT_GROWTH = 1.4  # [-], ratio of elements per half-width from one level to the next, from level 2
EDGE_GROWTH = 4  # [-], ratio of the refinement at the edges of the contact from one level to the next
MAX_EDGE_REFINEMENT = 128  # [-], elements inside the contact over those at its edges
FIRST_TERM_GROWTH = 2.0  # [-], ratio of pressure terms of level 1 to level 0
TERM_GROWTH = 1.5  # [-], ratio of pressure terms from one level to the next, from level 2
SPECTRAL_TOLERANCE = 1e-2  # [-], of the contact by the spectral engine to which a refined mesh is fitted
MAX_UNKNOWNS = 60_000  # [-], of a refined mesh; the mesh of its error estimate has four times as many


def initial_discretisation(problem: RollingProblem, mesh: RowMesh | None, tolerance: float) -> Discretisation:
    """Discretisation for the elastic contact on a given mesh or one for a relative tolerance of the forces [-].

    A prescribed load or peak pressure requires a rough solution with few terms, whose width may select a finer mesh.
    """
    half_width = elastic_estimate.expected_half_width(problem.layer, problem.roller, problem.material, problem.speed)
    fitted = _fitted(problem, half_width, mesh, tolerance)
    if problem.roller.indentation is not None:
        return fitted
    sliding = problem
    if problem.turns_with_friction:
        sliding = replace(problem, roller=replace(problem.roller, rolling="frictionless"))
    rough = solve_contact(sliding, replace(fitted, terms=INITIAL_TERMS), ROUGH_TOLERANCE)
    reach = max(-rough.patch.trailing, rough.patch.leading)
    if mesh is None and reach < fitted.half_width / elastic_estimate.WIDTH_RATIO**2:
        fitted = _fitted(problem, elastic_estimate.quantise_half_width(reach, fitted.half_width), mesh, tolerance)
    return replace(fitted, indentation=rough.indenter.indentation)


def fitted_discretisation(problem: RollingProblem, tolerance: float) -> Discretisation:
    """Discretisation of refinement level 1, whose mesh fits the contact at its own speed."""
    refined = refined_discretisation(problem, 1, tolerance, spectral_estimate(problem))
    return refined or initial_discretisation(problem, None, tolerance)


def refined_discretisation(
    problem: RollingProblem, level: int, tolerance: float, similar: "SpectralContactResult | FemContactResult | None"
) -> Discretisation | None:
    """Discretisation of a level of refinement from 1 to `MAX_LEVEL`, or None beyond `MAX_UNKNOWNS`.

    The mesh is fitted to the edges of a similar contact, or of the elastic contact.
    """
    if similar is None:
        first = initial_discretisation(problem, None, tolerance)
        edges, indentation = (-first.half_width, first.half_width), first.indentation
    else:
        edges, indentation = (similar.trailing, similar.leading), similar.indentation
        edges = edges if problem.speed > 0 else (-edges[1], -edges[0])
    layer, half_width = problem.layer, (edges[1] - edges[0]) / 2
    elements = int(np.ceil(elements_for(tolerance) * ELEMENT_GROWTH ** (level - 1)))
    at_edge = min(EDGE_REFINEMENT * EDGE_GROWTH**level, MAX_EDGE_REFINEMENT)
    mesh = graded_mesh(
        layer.height,
        half_width * (1 + 0.5 / (elements * at_edge)),  # places the edges within an element, not on a node
        elements,
        centre=(edges[0] + edges[1]) / 2,
        interfaces=layer.interfaces,
        edge=at_edge,
    )
    if mesh.dofs > MAX_UNKNOWNS:
        return None
    terms = _pressure_terms(layer, half_width) * FIRST_TERM_GROWTH * TERM_GROWTH ** (level - 1)
    return Discretisation(mesh, half_width, indentation, int(terms), None if similar is None else edges)


def spectral_estimate(problem: RollingProblem) -> SpectralContactResult | None:
    """Contact by the engine "spectral" without stick and with a vertical gap; None where that engine has none."""
    roller = problem.roller
    if not problem.traction_ratio:
        roller = replace(roller, rolling="frictionless")
    if roller.profile == "deformed":
        roller = replace(roller, profile="parabola")
    try:
        return spectral.roll(problem.layer, roller, problem.material, problem.speed, rtol=SPECTRAL_TOLERANCE)
    except RuntimeError:
        return None


def _fitted(problem: RollingProblem, half_width: float, mesh: RowMesh | None, tolerance: float) -> Discretisation:
    layer = problem.layer
    if half_width < MIN_HALF_WIDTH * layer.height:
        raise RuntimeError(f"a contact of {2 * half_width:.1g} m is too narrow for a mesh; use spectral")
    return Discretisation(
        mesh or mesh_for_error(layer.height, half_width, tolerance, layer.interfaces),
        half_width,
        elastic_estimate.contact_of_half_width(layer, problem.material, problem.roller.radius, half_width).indentation,
        _pressure_terms(layer, half_width),
    )


def _pressure_terms(layer: Layer, half_width: float) -> int:
    return int(min(BASE_TERMS + TERMS_PER_WIDTH * half_width / layer.top.thickness, MAX_TERMS))
