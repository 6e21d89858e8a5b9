"""The engine "fem": a rigid roller in steady motion over a layer of quadratic quadrilaterals in plane strain.

The layer of unit modulus is factorised once per mesh, Poisson's ratio and base and condensed to its surface
(`compliance`). A speed and a relaxation spectrum retard that response along the streamlines (`streamline`), a contact
patch with free edges lies on it (`patch`), and a roller that turns sticks and slips (`stickslip`). The load comes from
the surface, the resistance from the pressure on the slope of the roller and the shear, the energy balance from the
stresses and strains inside.

Envelope at default settings: contact half-widths from 0.001 to 3 layer heights (a slipping layer to 40), nu from 0 to
0.49, both bases, v tau/a from 1e-4 to 1e4, friction to 1. Load within 0.02 %, edges 0.2 % (viscoelastic 0.3 %) and peak
pressure 0.1 % of elastic layers; resistance of viscoelastic ones within 0.3 %; shear that sticks and slips within 2 %.
Plies that differ 20-fold, the top one a fifth of the half-width thick or more: the same, but for the edges and the peak
pressure of viscoelastic ones, 1.5 and 0.5 %.
"""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.fem.contact_patch import (
    FIRST_TERMS,
    BeyondWindowError,
    Patch,
    Roll,
    Surface,
    UnresolvedError,
    beyond_circle,
    interpolation,
    press,
    with_peaks,
)
from compact.engines.fem.convected_memory import retardation
from compact.engines.fem.fields import work_left
from compact.engines.fem.stick_slip import FrictionCondition, Shear, pressed_and_sheared
from compact.engines.fem.surface_compliance import condensed, stretched
from compact.engines.halfplane import pressure_exponent
from compact.engines.spectral import engine as spectral
from compact.engines.spectral.elastic_estimate import WIDTH_STEP, as_wide, half_width_met, shared_half_width
from compact.material.laws import Elastic
from compact.mesh import DEFAULT_ERROR, EDGE_REFINEMENT, RowMesh, elements_for, graded_mesh, mesh_for_error
from compact.numerics.validation import require_finite, require_known, require_positive
from compact.rolling_contact import ContactResult, Layer, Roller, require_on_target, require_torque_allowed

NARROWEST = 1e-7  # layer heights: half-width of a contact that a mesh of the layer can hold
TERMS = 12  # of the pressure: more resolve thinner edge layers, and blur the edges once they outrun the mesh
MORE_TERMS = 0.5  # per half-width over the top ply: the pressure on a thin one ends within its thickness of the edges
MOST_TERMS = 30
WINDOW = 1.3  # loaded zone over the half-width expected
WIDER = 1.5
ATTEMPTS = 8
SAMPLES = 201  # along the contact, in the result
TARGET_TOLERANCE = 1e-9  # of a prescribed load or peak pressure
TARGET_OF_TURNS = 1e-6  # the same of a roller that sticks and slips, whose shear is found to 1e-7 in turns
MET = 10.0  # times these, within which the contact that is returned has what is prescribed
ROUGH = 1e-2  # the same where only a mesh is to be chosen for it
SECANTS = 20
LEVELS = 4  # of refinement where the estimated error misses the tolerance; the first mesh is level 0
FINER = 1.4  # times as many elements per half-width on each of them but the first
FINER_EDGE = 4  # times smaller elements at the edges of the contact on each
MOST_AT_EDGE = 128  # times smaller than inside
MORE_PRESSURE = 2.0  # times as many terms on the first of them
MORE_PRESSURE_YET = 1.5  # times as many on each that follows
FORESEEN = 1e-2  # error of the contact by which a refined mesh is fitted
BUDGET = 60_000  # unknowns of a refined mesh; the one that judges its error has four times as many
JUDGES_TERMS = 2  # more of the pressure on the refined mesh, for each `MOST_TERMS` or part of them, see `_error`
CAUTION = 2.0  # times the difference from the refined solution, which is some four times as good, see `_error`
SCATTER = 0.15  # of the scatter of the peak pressure: for differences that are small by luck
SHARED_ERROR = 3e-6  # of both meshes


@dataclass(frozen=True)
class FemContactResult(ContactResult):
    """A `ContactResult` with what it took to find it and what `fields` needs.

    indentation : delta [m]
    creep : angular speed x radius/speed - 1 of a roller that sticks and slips, else None
    history : (trailing, leading, step over length) of every iteration for the edges, along x [m]
    layer, roller, material, speed, mesh : what was rolled, on which mesh
    forces : on the surface nodes, over the relaxed modulus [m], shape (2, n)
    """

    indentation: float = 0.0
    creep: float | None = None
    history: tuple = ()
    layer: Layer | None = None
    roller: Roller | None = None
    material: object = None
    speed: float = 0.0
    mesh: RowMesh | None = None
    forces: np.ndarray | None = None


def roll(layer, roller, material, speed, *, torque=None, mesh=None, tolerance=DEFAULT_ERROR, estimate=True):
    """One roller in steady motion over a linear layer, a `FemContactResult`: the engine "fem".

    Parameters
    ----------
    layer : Layer, of any height and plies
    roller : Roller, every profile; "frictionless", "sliding" with the traction f p on the mix along the travel all over
        the contact, "free" or "driven", which stick and slip
    material : Elastic or Viscoelastic
    speed : of the roller along x [m/s], not 0
    torque : on a roller that is free or driven, per unit length, + turning it the way it travels [N]; without it a
        free roller has none
    mesh : RowMesh of the layer, with a line of nodes at every interface of plies; without it one is chosen for the
        contact expected, the same at every speed where the indentation is prescribed
    tolerance : largest relative error of load and resistance [-], where no mesh is given: the mesh and the terms of
        the pressure are refined until the estimated errors are no larger; the default is a point of
        studies/speed_against_error.py: 0.03 % of the resistance there, 0.1 s a further speed
    estimate : False leaves the error out, `error` None, and the mesh at that of the first guess

    RuntimeError with the error reached and the remedy where the finest mesh allowed misses the tolerance.

    For speed < 0 leading and trailing stay + ahead, while x, shear_traction and resistance keep the fixed axis x. A
    slipping layer is held against shear behind the roller; the indentation counts from the surface ahead.

    >>> from compact.rolling_contact import Layer, Roller
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), Elastic(10e6, 0.3), speed=0.2)
    >>> f"load {rolled.load / 1e3:.2f} kN/m, edge {rolled.leading * 1e3:.2f} mm"
    'load 15.09 kN/m, edge 13.85 mm'
    """
    require_linear_range(layer, roller, material, speed, mesh, tolerance)
    require_torque_allowed(roller, torque)
    case = Case(layer, roller, material, speed, torque or 0.0)
    with threadpool_limits(1):  # matrices are small, threads only quarrel
        if mesh is None and estimate:
            return _to_tolerance(case, tolerance)
        return _solution(case, task_of(case, mesh, tolerance), estimate)


@dataclass(frozen=True)
class Case:
    layer: Layer
    roller: Roller
    material: Elastic
    speed: float
    torque: float = 0.0

    @property
    def friction(self):
        """Traction on the mix along +x over pressure, where all of the contact slides."""
        return float(np.sign(self.speed)) * self.roller.friction if self.roller.rolling == "sliding" else 0.0

    @property
    def sticks(self):
        return self.roller.rolling in ("free", "driven") and self.roller.friction > 0

    @property
    def sheared(self):
        return self.friction != 0 or self.sticks or self.roller.profile == "deformed"

    def pressed(self, indentation):
        exponent = float(pressure_exponent(self.material.poisson, self.friction))
        return Roll(self.roller.radius, indentation, self.roller.profile, self.friction, exponent)


@dataclass(frozen=True, eq=False)
class Contact:
    surface: Surface
    roll: Roll
    patch: Patch
    shear: Shear | None = None

    @property
    def force(self):
        """On the mix (x, y), over the relaxed modulus."""
        patch = self.patch
        along = patch.direction[0] - self.roll.slope(patch.x) * patch.direction[1]
        force = np.array([patch.integral(patch.pressure * part) for part in (along, patch.direction[1])])
        return force if self.shear is None else force + self.shear.sum

    @property
    def forces(self):
        """On the surface nodes, shape (2, n)."""
        forces = np.zeros((2, len(self.surface.x)))
        forces[:, self.surface.first : self.surface.last] = self.patch.forces
        if self.shear is not None:
            forces[:, self.surface.first : self.surface.last] += self.shear.forces
        return forces


@dataclass(frozen=True)
class _Task:
    """A mesh, the half-width it is fine for, the indentation to start from [m], the terms of the pressure, and the
    edges (trailing, leading) to start from in x [m], where they are known."""

    mesh: RowMesh
    half_width: float
    depth: float
    terms: int
    edges: tuple | None = None


def _solution(case, task, estimate=True):
    """The `FemContactResult` of a case on one mesh."""
    contact = contact_of(case, task)
    rolled = _rolled(case, task.mesh, contact)
    rolled = replace(rolled, work_residual=_work_residual(case, rolled, contact))
    tolerance = MET * (TARGET_OF_TURNS if case.sticks else TARGET_TOLERANCE)
    require_on_target(rolled, case.roller, tolerance, torque=_torques(case, contact))
    return replace(rolled, error=_error(case, task, rolled, contact)) if estimate else rolled


def _to_tolerance(case, tolerance):
    """The `FemContactResult` whose estimated errors are within the tolerance, of a mesh and a pressure as fine as that takes.

    Creep times that are short beside the passage of the roller make layers at the edges of the contact, which a mesh
    of the expected contact is too coarse for and few terms of the pressure are too smooth for. Each level of
    refinement fits the mesh to the edges of the contact found last, at first by the engine "spectral" without stick.
    """
    best, failed, foreseen, meshes = None, None, None, 0
    for level in range(LEVELS + 1):
        try:
            task = task_of(case, None, tolerance) if level == 0 else _refined(case, level, tolerance, best or foreseen)
            if task is None:
                break
            meshes += 1
            rolled = _solution(case, task)
        except UnresolvedError as error:
            failed = error
        else:
            if max(rolled.error) <= tolerance:
                return rolled
            best = min(best or rolled, rolled, key=lambda each: max(each.error))
        foreseen = foreseen or _foreseen(case)
    if best is None:
        raise UnresolvedError(
            f"no contact found on {meshes} meshes of up to {BUDGET} unknowns; {_remedy(case)}; {failed}"
        )
    raise RuntimeError(_missed(best, tolerance, case))


def _remedy(case):
    if case.sticks or case.roller.profile == "deformed":
        return "measure the gap vertically and leave stick and slip out, which spectral takes"
    return "use spectral"


def _missed(best, tolerance, case):
    """The reason why a tolerance is not met, and the remedy."""
    load, resistance = best.error
    return (
        f"`tolerance` {tolerance:g} is not met: the estimated error of the load is {load:.1e}, that of the resistance "
        f"{resistance:.1e}, on a mesh of {best.mesh.dofs} unknowns, the best of up to {LEVELS} refinements within "
        f"{BUDGET} unknowns; raise the tolerance to {_rounded_up(max(best.error)):g}, or {_remedy(case)}"
    )


def _rounded_up(error):
    digit = 10.0 ** (np.floor(np.log10(error)) - 1)
    return float(np.ceil(error / digit) * digit)


def fitted_task(case, tolerance):
    """The `_Task` of the first level of refinement, whose mesh fits the contact at its own speed."""
    return _refined(case, 1, tolerance, _foreseen(case)) or task_of(case, None, tolerance)


def _foreseen(case):
    """The contact by the engine "spectral", of a roller that does not stick and a gap that is vertical; None where it
    has none."""
    rolling = "sliding" if case.friction else "frictionless"
    profile = "parabola" if case.roller.profile == "deformed" else case.roller.profile
    roller = replace(case.roller, rolling=rolling, profile=profile)
    try:
        return spectral.roll(case.layer, roller, case.material, case.speed, rtol=FORESEEN)
    except RuntimeError:
        return None


def _refined(case, level, tolerance, near):
    """The `_Task` of a level of refinement about a contact near the one sought; None beyond the budget.

    near : a `ContactResult` with its indentation; without one the mesh keeps to the contact expected
    """
    if near is None:
        task = task_of(case, None, tolerance)
        edges, depth = (-task.half_width, task.half_width), task.depth
    else:
        edges, depth = (near.trailing, near.leading), near.indentation
        edges = edges if case.speed > 0 else (-edges[1], -edges[0])
    layer, half_width = case.layer, (edges[1] - edges[0]) / 2
    elements = int(np.ceil(elements_for(tolerance) * FINER ** (level - 1)))
    smaller = min(EDGE_REFINEMENT * FINER_EDGE**level, MOST_AT_EDGE)
    mesh = graded_mesh(
        layer.height,
        half_width * (1 + 0.5 / (elements * smaller)),  # edges within an element: on a node their slopes would jump
        elements,
        centre=(edges[0] + edges[1]) / 2,
        interfaces=layer.interfaces,
        edge=smaller,
    )
    terms = _terms(layer, half_width) * MORE_PRESSURE * MORE_PRESSURE_YET ** (level - 1)
    task = _Task(mesh, half_width, depth, int(terms), None if near is None else edges)
    return None if mesh.dofs > BUDGET else task


def _terms(layer, half_width):
    """Terms of the pressure of the contact expected."""
    return int(min(TERMS + MORE_TERMS * half_width / layer.top.thickness, MOST_TERMS))


def task_of(case, mesh, tolerance):
    """The `_Task` of an elastic contact; of the contact itself with few terms where indentation is not prescribed."""
    task = _fitted(case, half_width_met(case.layer, case.roller, case.material, case.speed), mesh, tolerance)
    if case.roller.indentation is not None:
        return task
    slides = replace(case, roller=replace(case.roller, rolling="frictionless")) if case.sticks else case
    rough = contact_of(slides, replace(task, terms=FIRST_TERMS), ROUGH)
    reach = max(-rough.patch.trailing, rough.patch.leading)
    if mesh is None and reach < task.half_width / WIDTH_STEP**2:
        task = _fitted(case, shared_half_width(reach, task.half_width), mesh, tolerance)
    return replace(task, depth=rough.roll.indentation)


def _fitted(case, half_width, mesh, tolerance):
    layer = case.layer
    if half_width < NARROWEST * layer.height:
        raise RuntimeError(f"a contact of {2 * half_width:.1g} m is too narrow for a mesh; use spectral")
    return _Task(
        mesh or mesh_for_error(layer.height, half_width, tolerance, layer.interfaces),
        half_width,
        as_wide(layer, case.material, case.roller.radius, half_width).indentation,
        _terms(layer, half_width),
    )


def contact_of(case, task, tolerance=TARGET_TOLERANCE):
    """The contact of a case."""
    return widening(task, lambda window: at_target(case, surface_of(case, task.mesh, window), task, tolerance))


def widening(task, find):
    """find(window) on a loaded zone about the mesh's centre that widens until it holds the contact."""
    window = WINDOW * task.half_width
    for _ in range(ATTEMPTS):
        try:
            return find(window)
        except BeyondWindowError as beyond:
            window, reason = WIDER * window, beyond
    raise UnresolvedError(f"contact within {window:.3g} m still not held: {reason}")


def surface_of(case, mesh, window):
    """The `Surface` of the layer within `window` of the mesh's centre, as the material retards it at the speed."""
    surface = elastic_surface(case, mesh, window)
    C = retardation(surface.x, case.material, case.speed)
    return replace(surface, response=np.einsum("ca,iakb->ickb", C, surface.response, optimize=True))


def elastic_surface(case, mesh, window):
    """The `Surface` of the layer of relaxed modulus within `window` of the mesh's centre."""
    behind = 0 if case.speed > 0 or case.layer.base == "bonded" else 1
    return condensed(mesh, case.material.poisson, case.layer, window, case.sheared, behind)


def stretched_surface(case, mesh, window):
    """The `Surface` whose response is the derivative of that of `elastic_surface` as every x grows in proportion."""
    behind = 0 if case.speed > 0 or case.layer.base == "bonded" else 1
    return stretched(mesh, case.material.poisson, case.layer, window, case.sheared, behind)


def at_target(case, surface, task, tolerance=TARGET_TOLERANCE, start=None):
    """The contact with the indentation, load or peak pressure prescribed, the latter two to a tolerance, from a contact
    at which to start or from none."""
    if case.roller.indentation is not None:
        return _settled(case, surface, case.pressed(case.roller.indentation), task, start)
    tolerance = max(tolerance, TARGET_OF_TURNS) if case.sticks else tolerance
    logs, misses, history, contact, beyond = [], [], (), start, None
    guess = np.log(task.depth)
    for _ in range(SECANTS):
        found = _settled(case, surface, case.pressed(float(np.exp(guess))), task, contact)
        history += found.patch.history
        if _is_beyond_circle(found):  # a force needs the slope of the circle
            beyond, guess = found, (guess + logs[-1]) / 2 if logs else guess - 1
            continue
        contact = found
        logs.append(guess)
        misses.append(_miss(case, contact))
        if abs(misses[-1]) < tolerance:
            return replace(contact, patch=replace(contact.patch, history=history))
        slope = 1.2 if len(logs) == 1 else (misses[-1] - misses[-2]) / (logs[-1] - logs[-2])
        guess = guess - np.clip(misses[-1] / slope, -1, 1)
    if beyond is not None:
        raise RuntimeError(beyond_circle(*beyond.patch.edges, case.roller.radius))
    nearest, (name, value) = int(np.argmin(np.abs(misses))), case.roller.target
    off, depth = np.expm1(misses[nearest]), 1e3 * np.exp(logs[nearest])
    raise UnresolvedError(
        f"`{name}` {value:.6g} not met in {len(logs)} depths; the nearest was {off:+.1e} off at {depth:.4g} mm"
    )


def _settled(case, surface, roll, task, start=None):
    """The contact at an indentation, from another one on, with shear where the roller sticks and slips."""
    terms, (patch, shear) = task.terms, (None, None) if start is None else (start.patch, start.shear)
    if patch is None or not case.sticks:
        patch = press(surface, roll, terms, patch, task.edges)
    if not case.sticks:
        return Contact(surface, roll, with_peaks(surface, roll, patch))
    direction = np.sign(case.speed)
    asked = -direction * case.torque / case.roller.radius / case.material.youngs_modulus
    grip = FrictionCondition(case.roller.friction, asked, direction)
    return Contact(surface, roll, *pressed_and_sheared(surface, roll, terms, grip, patch, shear))


def _miss(case, contact):
    """Log of the load or peak pressure over the one prescribed."""
    modulus, roller = case.material.youngs_modulus, case.roller
    if roller.load is not None:
        return float(np.log(-modulus * contact.force[1] / roller.load))
    return float(np.log(modulus * contact.patch.peak / roller.peak_pressure))


def _rolled(case, mesh, contact):
    """Forces and edges of a contact, in the words of the engines."""
    _refuse_beyond_circle(contact)
    patch, shear, E = contact.patch, contact.shear, case.material.youngs_modulus
    x, pressure = patch.sampled(SAMPLES)
    traction = case.friction * pressure if shear is None else shear.at(x)
    edges = np.array([patch.trailing, patch.leading])
    trailing, leading = edges if case.speed > 0 else -edges[::-1]
    return FemContactResult(
        load=float(-E * contact.force[1]),
        resistance=float(E * contact.force[0]),
        leading=float(leading),
        trailing=float(trailing),
        x=x,
        pressure=E * pressure,
        shear_traction=E * traction,
        indentation=contact.roll.indentation,
        peak_pressure=float(E * patch.peak),
        creep=None if shear is None else shear.creep,
        history=patch.history,
        layer=case.layer,
        roller=case.roller,
        material=case.material,
        speed=case.speed,
        mesh=mesh,
        forces=contact.forces,
    )


def _torques(case, contact):
    """(prescribed, reached) torque on a roller that sticks and slips, per unit length [N]; None of any other."""
    if contact.shear is None:
        return None
    sheared = contact.patch.integral(contact.shear.at(contact.patch.x))
    return case.torque, float(-np.sign(case.speed) * case.roller.radius * case.material.youngs_modulus * sheared)


def _refuse_beyond_circle(contact):
    """A roller touches with its lower half only."""
    if _is_beyond_circle(contact):
        raise RuntimeError(beyond_circle(*contact.patch.edges, contact.roll.radius))


def _is_beyond_circle(contact):
    """True if the roller touches with more than its lower half."""
    patch, roll = contact.patch, contact.roll
    beyond = {
        "parabola": False,
        "circle": np.abs(patch.x).max() >= roll.radius,
        "deformed": (patch.direction - patch.shear)[1].max() >= 0,  # a normal that no longer points down
    }
    return bool(beyond[roll.profile])


def _error(case, task, rolled, contact):
    """Estimated relative errors of load and resistance; UnresolvedError where the refined solution is not found.

        load        2 |P - P'|/P' + shared,  shared = 0.15 scatter of the peak pressure + 3e-6
        resistance  (2 |F - F'| + shared |F - f P|)/max(|F'|, 1e-3 P) + work_residual/2

    P', F' come from the same contact with every element cut in four and more terms of the pressure, which errs by
    a quarter of the coarser one or less. It keeps what is prescribed, but where that is the load, P' is the load at the
    indentation found. f P of a sliding roller is then exact and is taken off; else it is not. The balance of energy
    knows of edge layers that are too thin for either mesh. Against the spectral engine on 240 random scenes, each with
    indentation, load and peak pressure prescribed: error told over true error never below 0.3, below 0.5 in 2 of 1357,
    median 2.7 and 2.9, 95 % below 16.
    """
    more = JUDGES_TERMS * int(np.ceil(task.terms / MOST_TERMS))
    edges = contact.patch.edges if task.edges else None
    finer = replace(task, mesh=task.mesh.refined(), depth=rolled.indentation, terms=task.terms + more, edges=edges)
    try:
        surface = surface_of(case, finer.mesh, contact.surface.x[contact.surface.last - 1] - task.mesh.centre)
        judge = as_deep = _rolled(case, finer.mesh, at_target(case, surface, finer))
        if case.roller.load is not None:
            as_deep = _rolled(case, finer.mesh, _settled(case, surface, case.pressed(finer.depth), finer))
    except UnresolvedError as error:
        raise UnresolvedError(f"the error cannot be estimated, as on a finer mesh {error}") from error
    shared = SCATTER * contact.patch.scatter + SHARED_ERROR
    known = 0.0 if case.roller.load is None else case.friction * rolled.load
    load = CAUTION * abs(rolled.load / as_deep.load - 1) + shared
    resistance = CAUTION * abs(rolled.resistance - judge.resistance) + shared * abs(rolled.resistance - known)
    return load, resistance / _scale(judge) + rolled.work_residual / 2


def _scale(rolled):
    """What errors of the resistance are relative to."""
    return max(abs(rolled.resistance), 1e-3 * rolled.load)


def _work_residual(case, rolled, contact):
    """What the roller gives, its torque too, less what the layer keeps and what slip takes, over the resistance."""
    patch, shear, E = contact.patch, contact.shear, case.material.youngs_modulus
    direction = np.sign(case.speed)
    given, lost = rolled.resistance + direction * _held_behind(case, contact), 0.0
    if shear is not None:
        given += direction * case.torque / case.roller.radius * (1 + shear.creep)
        lost = direction * E * shear.lost
    elif case.friction:
        stretch = patch.displacement @ interpolation(contact.surface.x, patch.x, derivative=True).T
        slip = np.array([[1.0], [0.0]]) + stretch  # of the roller on the mix, over the speed
        lost = E * patch.integral(patch.pressure * np.sum(patch.shear * slip, axis=0))
    return float(abs(given - direction * work_left(rolled) - lost) / _scale(rolled))


def _held_behind(case, contact):
    """What holding a slipping layer behind the roller gives more than the stretch e there stores, per length [N].

        Q e - Q e/2,  e = (1 - nu^2) Q/(E sum c thickness)

    Q : shear on the layer [N/m];  c : stiffness of a ply
    """
    if case.layer.base == "bonded":
        return 0.0
    E, nu, Q = case.material.youngs_modulus, case.material.poisson, contact.forces[0].sum()
    across = sum(ply.stiffness * ply.thickness for ply in case.layer.stack)
    return float(E * (1 - nu**2) * Q**2 / (2 * across))


def require_linear_range(layer, roller, material, speed, mesh, tolerance):
    require_finite(speed=speed)
    require_positive(tolerance=tolerance)
    if speed == 0:
        raise ValueError("`speed` must not be 0, got 0: the resistance is set-valued there; say which way it goes")
    if not isinstance(material, Elastic):
        raise ValueError(f"`material` must be Elastic or Viscoelastic, got {type(material).__name__}")
    require_known("rolling", roller.rolling, ("frictionless", "sliding", "free", "driven"))
    require_known("profile", roller.profile, ("parabola", "circle", "deformed"))
    require_known("base", layer.base, ("bonded", "slip"))
    if mesh is not None and abs(mesh.height - layer.height) > 1e-6 * layer.height:
        raise ValueError(f"`mesh` must be as high as the layer, {layer.height!r} m, got {mesh.height.item()!r} m")
    missed = [y for y in layer.interfaces if mesh is not None and np.abs(mesh.y - y).min() > 1e-6 * layer.height]
    if missed:
        raise ValueError(
            f"`mesh` must have a line of nodes at every interface of plies, none at y = {missed[0]:.6g} m; "
            f"shift the nearest one there, or leave the mesh to `tolerance`"
        )
