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

from compact.compliance import condensed
from compact.expected import as_wide, expected
from compact.fields import fields, work_left, write_fields
from compact.halfplane import pressure_exponent
from compact.material import Elastic
from compact.mesh import DEFAULT_ERROR, RowMesh, for_error
from compact.patch import BeyondWindowError, Patch, Roll, Surface, interpolation, press
from compact.records import Layer, Rolled, Roller
from compact.refuse import refuse_nonfinite, refuse_nonpositive, refuse_unknown
from compact.stickslip import DrawnRoll, Shear, stick_and_slip
from compact.streamline import retardation

__all__ = ["FemRolled", "fields", "roll", "write_fields"]

NARROWEST = 1e-7  # layer heights: half-width of a contact that a mesh of the layer can hold
TERMS = 12  # of the pressure: more resolve thinner edge layers, and blur the edges once they outrun the mesh
MORE_TERMS = 0.5  # per half-width over the top ply: the pressure on a thin one ends within its thickness of the edges
MOST_TERMS = 30
WINDOW = 1.3  # loaded zone over the half-width expected
WIDER = 1.5
ATTEMPTS = 8
SAMPLES = 201  # along the contact, in the result
PEAK_SAMPLES = 2001
TARGET_TOLERANCE = 1e-9  # of a prescribed load or peak pressure
SECANTS = 20
TURNS = 30  # of pressure and shear
TURN_TOLERANCE = 1e-6  # of the peak pressure
MODULUS_STEP = 1.25  # speeds whose dynamic moduli differ by less share a mesh where the load is prescribed
LOAD_SHARE, RESISTANCE_SHARE = 1 / 3, 0.6  # of the difference from the coarser solution, told as the error
SHARED_ERROR = 2.5e-5  # that both meshes have in common; the shares and it come from 80 random scenes refined once more


@dataclass(frozen=True)
class FemRolled(Rolled):
    """A `Rolled` with what it took to find it and what `fields` needs.

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


def roll(layer, roller, material, speed, *, torque=None, mesh=None, tolerance=DEFAULT_ERROR):
    """One roller in steady motion over a linear layer, a `FemRolled`: the engine "fem".

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
    tolerance : relative error wanted of load and resistance [-], where no mesh is given; the default is a
        point of studies/speed_against_error.py: 0.03 % of the resistance there, 0.1 s a further speed

    For speed < 0 leading and trailing stay + ahead, while x, shear_traction and resistance keep the fixed axis x. A
    slipping layer is held against shear behind the roller; the indentation counts from the surface ahead.

    >>> from compact.records import Layer, Roller
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), Elastic(10e6, 0.3), speed=0.2)
    >>> f"load {rolled.load:.0f} N/m, edge {rolled.leading * 1e3:.2f} mm, peak {rolled.peak_pressure / 1e3:.0f} kPa"
    'load 15085 N/m, edge 13.85 mm, peak 694 kPa'
    """
    _refuse_beyond_linear(layer, roller, material, speed, mesh, tolerance)
    _refuse_torque(roller, torque)
    case = _Case(layer, roller, material, speed, torque or 0.0)
    with threadpool_limits(1):  # matrices are small, threads only quarrel
        half_width = _expected_half_width(case)
        if half_width < NARROWEST * layer.height:
            raise RuntimeError(f"a contact of {2 * half_width:.1g} m is too narrow for a mesh; use spectral")
        mesh = for_error(layer.height, half_width, tolerance, layer.interfaces) if mesh is None else mesh
        contact = _contact(case, mesh, half_width)
        rolled = _rolled(case, mesh, contact)
        return _with_trust(rolled, _coarser(case, mesh, half_width), _work_residual(case, rolled, contact))


@dataclass(frozen=True)
class _Case:
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
class _Contact:
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


def _contact(case, mesh, half_width):
    """The contact of a case on a mesh, in a loaded zone that widens until it holds it."""
    terms = int(min(TERMS + MORE_TERMS * half_width / case.layer.top.thickness, MOST_TERMS))
    window = WINDOW * half_width
    for _ in range(ATTEMPTS):
        behind = 0 if case.speed > 0 or case.layer.base == "bonded" else 1
        surface = condensed(mesh, case.material.poisson, case.layer, window, case.sheared, behind)
        C = retardation(surface.x, case.material, case.speed)
        surface = replace(surface, response=np.einsum("ca,iakb->ickb", C, surface.response, optimize=True))
        try:
            return _at_target(case, surface, half_width, terms)
        except BeyondWindowError as beyond:
            window, reason = WIDER * window, beyond
    raise RuntimeError(f"contact on |x| < {window:.3g} m still not held: {reason}")


def _at_target(case, surface, half_width, terms):
    """The contact with the indentation, load or peak pressure prescribed."""
    if case.roller.indentation is not None:
        return _settled(case, surface, case.pressed(case.roller.indentation), terms)
    logs, misses, history, patch = [], [], (), None
    guess = np.log(as_wide(case.layer, case.material, case.roller.radius, half_width).indentation)
    for _ in range(SECANTS):
        contact = _settled(case, surface, case.pressed(float(np.exp(guess))), terms, patch)
        patch = contact.patch
        history += patch.history
        logs.append(guess)
        misses.append(_miss(case, contact))
        if abs(misses[-1]) < TARGET_TOLERANCE:
            return replace(contact, patch=replace(patch, history=history))
        slope = 1.2 if len(logs) == 1 else (misses[-1] - misses[-2]) / (logs[-1] - logs[-2])
        guess = guess - np.clip(misses[-1] / slope, -1, 1)
    reached = [(float(np.exp(log)), miss) for log, miss in zip(logs, misses, strict=True)]
    raise RuntimeError(f"target not reached: (indentation, log of value over target) were {reached}")


def _settled(case, surface, roll, terms, start=None):
    """The contact at an indentation; pressure and shear in turn where the roller sticks and slips."""
    patch = press(surface, roll, terms, start)
    if not case.sticks:
        return _Contact(surface, roll, patch)
    direction = np.sign(case.speed)
    asked = -direction * case.torque / case.roller.radius / case.material.youngs_modulus
    moves, history, known = [], patch.history, None
    for _ in range(TURNS):
        shear = stick_and_slip(surface, patch, case.roller.friction, asked, direction)
        if known is not None:
            moves.append(
                np.abs(shear.traction - np.interp(shear.x, known.x, known.traction)).max() / patch.pressure.max()
            )
            if moves[-1] < TURN_TOLERANCE:
                return _Contact(surface, roll, replace(patch, history=history), shear)
        drawn = DrawnRoll(**vars(roll), nodes=surface.x, drawn=shear.displacement)
        patch, known = press(surface, drawn, terms, patch), shear
        history += patch.history
    raise RuntimeError(f"pressure and shear did not settle: changes of shear over peak pressure were {moves}")


def _miss(case, contact):
    """Log of the load or peak pressure over the one prescribed."""
    modulus, roller = case.material.youngs_modulus, case.roller
    if roller.load is not None:
        return float(np.log(-modulus * contact.force[1] / roller.load))
    return float(np.log(modulus * contact.patch.sampled(PEAK_SAMPLES)[1].max() / roller.peak_pressure))


def _rolled(case, mesh, contact):
    """Forces and edges of a contact, in the words of the engines."""
    _refuse_beyond_circle(contact)
    patch, shear, E = contact.patch, contact.shear, case.material.youngs_modulus
    x, pressure = patch.sampled(SAMPLES)
    traction = case.friction * pressure if shear is None else np.interp(x, shear.x, shear.traction)
    edges = np.array([patch.trailing, patch.leading])
    trailing, leading = edges if case.speed > 0 else -edges[::-1]
    return FemRolled(
        load=float(-E * contact.force[1]),
        resistance=float(E * contact.force[0]),
        leading=float(leading),
        trailing=float(trailing),
        x=x,
        pressure=E * pressure,
        shear_traction=E * traction,
        indentation=contact.roll.indentation,
        peak_pressure=float(E * patch.sampled(PEAK_SAMPLES)[1].max()),
        creep=None if shear is None else shear.creep,
        history=patch.history,
        layer=case.layer,
        roller=case.roller,
        material=case.material,
        speed=case.speed,
        mesh=mesh,
        forces=contact.forces,
    )


def _refuse_beyond_circle(contact):
    """A roller touches with its lower half only."""
    patch, roll = contact.patch, contact.roll
    beyond = {
        "parabola": False,
        "circle": np.abs(patch.x).max() >= roll.radius,
        "deformed": (patch.direction - patch.shear)[1].max() >= 0,  # a normal that no longer points down
    }
    if beyond[roll.profile]:
        raise RuntimeError(
            f"the contact, from {patch.trailing:.3g} to {patch.leading:.3g} m, is wider than the circle of radius "
            f"{roll.radius:g} m; press less"
        )


def _coarser(case, mesh, half_width):
    """The result on every second line of nodes, or None if these cannot hold the contact."""
    try:
        coarse = mesh.coarsened(case.layer.interfaces)
        return _rolled(case, coarse, _contact(case, coarse, half_width))
    except RuntimeError:
        return None


def _with_trust(rolled, coarse, work_residual):
    """The result with its energy balance and the estimated relative errors of load and resistance.

    `coarse` is the same contact on every second line of nodes, None where that mesh is too coarse to hold it. The
    balance of energy knows of errors of the resistance that both meshes share.
    """
    if coarse is None:
        return replace(rolled, work_residual=work_residual)
    load = abs(rolled.load - coarse.load) / rolled.load
    resistance = abs(rolled.resistance - coarse.resistance) / _scale(rolled)
    error = max(LOAD_SHARE * load, SHARED_ERROR), max(RESISTANCE_SHARE * resistance, work_residual / 2, SHARED_ERROR)
    return replace(rolled, error=error, work_residual=work_residual)


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


def _expected_half_width(case):
    """Half-width of the elastic frictionless contact; the modulus matters only where the indentation is not given."""
    relaxed = _expected(case).half_width
    if case.roller.indentation is not None or not getattr(case.material, "branches", ()):
        return relaxed
    E, instant = case.material.youngs_modulus, case.material.instant_modulus
    modulus = float(abs(case.material.complex_modulus(case.speed / relaxed)))
    step = np.floor(np.log(modulus / E) / np.log(MODULUS_STEP))  # down, so that the mesh is wide enough
    shared = instant if modulus > 0.95 * instant else float(E * MODULUS_STEP**step)
    return _expected(case, shared).half_width


def _expected(case, youngs_modulus=None):
    """The `Expected` contact of a case, relaxed or of another modulus."""
    targets = ((name, getattr(case.roller, name)) for name in ("indentation", "load", "peak_pressure"))
    target, value = next((name, value) for name, value in targets if value is not None)
    elastic = Elastic(youngs_modulus or case.material.youngs_modulus, case.material.poisson)
    return expected(case.layer, elastic, case.roller.radius, target, value)


def _refuse_beyond_linear(layer, roller, material, speed, mesh, tolerance):
    refuse_nonfinite(speed=speed)
    refuse_nonpositive(tolerance=tolerance)
    if speed == 0:
        raise ValueError("`speed` must not be 0, got 0: the resistance is set-valued there; say which way it goes")
    if not isinstance(material, Elastic):
        raise ValueError(f"`material` must be Elastic or Viscoelastic, got {type(material).__name__}")
    refuse_unknown("rolling", roller.rolling, ("frictionless", "sliding", "free", "driven"))
    refuse_unknown("profile", roller.profile, ("parabola", "circle", "deformed"))
    refuse_unknown("base", layer.base, ("bonded", "slip"))
    if mesh is not None and abs(mesh.height - layer.height) > 1e-6 * layer.height:
        raise ValueError(f"`mesh` must be as high as the layer, {layer.height!r} m, got {mesh.height.item()!r} m")
    missed = [y for y in layer.interfaces if mesh is not None and np.abs(mesh.y - y).min() > 1e-6 * layer.height]
    if missed:
        raise ValueError(
            f"`mesh` must have a line of nodes at every interface of plies, none at y = {missed[0]:.6g} m; "
            f"shift the nearest one there, or leave the mesh to `tolerance`"
        )


def _refuse_torque(roller, torque):
    turns = roller.rolling in ("free", "driven")
    if torque is not None:
        refuse_nonfinite(torque=torque)
        if torque and not (turns and roller.friction > 0):
            raise ValueError(
                f"`torque` needs a roller that is 'free' or 'driven' and has `friction`, got {torque!r} for "
                f"'{roller.rolling}' with {roller.friction!r}"
            )
    elif roller.rolling == "driven":
        raise ValueError("`torque` must be given for a 'driven' roller, got None; a 'free' one needs none")
