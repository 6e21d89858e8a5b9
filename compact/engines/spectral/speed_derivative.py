"""Slow changes of speed in Fourier space: dF_ss/dv and M of the engine "spectral".

Seen from the roller a creep branch z of a displacement w follows z + theta (dz/dt - v dz/dx) = w. While dv/dt = a is
small, p = p_ss(x; v) + a p_1(x; v) and d/dt = a d/dv. With the symbols D = 1/(1 - ik v theta) of the branches and the
C, S of `kernel` this leaves, in contact and with edges that are free to move,

    C S dp_ss/dv = -C_v S p_ss,    C S p_1 = Z S p_ss + Y S dp_ss/dv,
    C_v = sum share/v (D^2 - D),   Y = C_v/(ik) = sum share theta D^2,   Z = C_vv/(2ik) = sum share theta/v (D^3 - D^2).

Both pressures are singular at the edges, which move, so they are not looked for as functions of x. A change of the
pressure is one of its coefficients b, of the log of the half-width and of the centre; all that goes with the contact
is held at xi = (x - centre)/half-width, and at a fixed x a field q changes by

    dq|x = dq|xi - (d centre + half-width xi d log half-width) dq/dx.

Powers of D are derivatives of D over the length l = v theta, D^2 = (l D)' and D^3 = (l^2 D)''/2, and these are taken
from the exact matrices of `kernel` at five lengths. Speeds are counted by their logs, so that what enters is v C_v,
v Y and v^2 Z.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from threadpoolctl import threadpool_limits

from compact.engines.spectral import engine as spectral
from compact.engines.spectral import galerkin_system
from compact.engines.spectral.elastic_estimate import first_half_width
from compact.numerics.validation import require_positive
from compact.resistance import ResistanceExpansion

RTOL = 1e-4  # wanted error of M over the larger of |M| and |tau dF_ss/dv|
ACCEPTED = 1e-2  # the same above which nothing is returned
RUNGS = 3  # of the ladder of modes, that agree: a short branch may hide from two
CAUTION = 2.0  # times the largest change among them
DIFFERENCES = 1e-6  # error by differences for derivatives, in the same terms
ROUNDING = 1e-12  # error by arithmetic, in the same terms, over the longest length of creep in half-widths
APART = 0.01  # relative distance of the lengths from which powers of D are made
NUDGE = 3e-4  # relative change of the half-width either way
STENCIL = np.arange(-2, 3)
FIRST = np.array([1, -8, 0, 8, -1]) / 12
SECOND = np.array([-1, 16, -30, 16, -1]) / 12


def modulation(layer, roller, material, speed, *, rtol=RTOL):
    """The `ResistanceExpansion` of a roller on a linear layer, to an error of `rtol` over the larger of |M| and |tau dF_ss/dv|.

    layer, roller, material, speed : as of `spectral.roll`, sliding rollers too

    The roller keeps what it prescribes all through the motion. Speeds so low that the mix creeps along less than 1e-10
    half-widths leave no digits; RuntimeError says so.
    """
    spectral.require_spectral_range(layer, roller, material, speed)
    require_positive(rtol=rtol)
    branches = getattr(material, "branches", ())
    if not branches:
        rolled = spectral.roll(layer, roller, material, speed)
        return ResistanceExpansion(speed, rolled.resistance, slope=0.0, added_mass=0.0, error=0.0, relaxation_time=0.0)
    scene = spectral.scene_of(layer, roller, material, speed)
    time = max(time for _, time in branches)
    first = min(first_half_width(layer, material, roller.radius, scene.target, scene.value), scene.widest)
    with threadpool_limits(1):  # matrices are small, threads only quarrel
        resistance, slope, added_mass, error = _resolved(scene, first, rtol, time * abs(speed))
    return ResistanceExpansion(
        speed=speed,
        resistance=float(np.sign(speed) * resistance),
        slope=float(slope / abs(speed)),
        added_mass=float(added_mass / speed**2),
        error=float(error / speed**2),
        relaxation_time=time,
    )


def _resolved(scene, half_width, rtol, reach):
    """(F_ss, v dF_ss/dv, v^2 M, error of the last), of as many modes as `rtol` asks for; `reach` is v tau [m]."""
    masses, told, crept = [], [], scene.ground.creep.lengths[-1]
    for modes in spectral.LADDER:
        contact = spectral.settle(scene, modes, half_width, [])
        half_width = contact.half_width
        if not ROUNDING * half_width < ACCEPTED * crept:
            raise RuntimeError(
                f"the mix creeps along {crept / half_width:.1g} half-widths only, too short to tell M; it has reached "
                "the limit of a lag"
            )
        slope, mass = _followed(scene, contact)
        masses.append(mass)
        if len(masses) < RUNGS:
            continue
        scale = max(abs(mass), reach * abs(slope))
        changed = CAUTION * np.abs(np.diff(masses[-RUNGS:])).max() / scale
        told.append((modes, float(changed)))
        if changed <= rtol:
            break
    if not changed <= max(rtol, ACCEPTED):
        raise RuntimeError(f"M does not settle: (modes, error over the larger of |M| and |tau dF/dv|) were {told}")
    return contact.resistance, slope, mass, (changed + DIFFERENCES + ROUNDING * half_width / crept) * scale


def _followed(scene, contact):
    """v dF_ss/dv and v^2 M of a contact."""
    near, creep = _Near(scene, contact), scene.ground.creep
    length = creep.lengths
    faster = near.surface(_powers(creep, -1, 1, 0))  # of v C_v
    change = near.change(faster)
    late = near.surface(_powers(creep, 0, -length, length))  # of v^2 Z
    late += near.surface_changed(_powers(creep, 0, length, 0), change, faster)  # of v Y
    return near.pushed @ change, near.pushed @ near.change(-late)


def _powers(creep, first, second, third):
    """The `Creep` sum share (first D + second D^2 + third D^3), by central differences over the length of each D."""
    ratio = 1 + APART * STENCIL
    shares = np.multiply.outer(creep.shares * first, STENCIL == 0)
    shares = shares + np.multiply.outer(creep.shares * second, ratio * FIRST / APART)
    shares = shares + np.multiply.outer(creep.shares * third, ratio**2 * SECOND / (2 * APART**2))
    return galerkin_system.Creep(0.0, shares.ravel(), np.outer(creep.lengths, ratio).ravel())


@dataclass(frozen=True)
class _Near:
    """A contact and what changes of it do.

    A change is one of the coefficients b, the log of the half-width and the centre [m], shape (modes + 2,). A surface
    is told by -u' under T_0 ... T_modes and u under T_0, shape (modes + 2,) too.
    """

    scene: spectral.Scene
    contact: spectral.Contact

    @property
    def x(self):
        """Nodes of the tests [m] from the middle of the contact."""
        return self.contact.half_width * self.contact.system.basis.nodes

    def surfaces(self, creep, wider=0.0):
        """Surfaces under the pressures of b_k = 1 after any `Creep`, shape (modes + 2, modes).

        wider : by what share the contact is so
        """
        ground, a = replace(self.scene.ground, creep=creep), self.contact.half_width * (1 + wider)
        system = galerkin_system.system(ground, len(self.contact.coefficients), a)
        return a / self.scene.radius * np.vstack([system.rows, a * system.depths])

    def surface(self, creep):
        """The surface under the pressure of the contact after any `Creep`."""
        return self.surfaces(creep) @ self.contact.coefficients

    def widened(self, creep):
        """What the surface changes with the log of the half-width, b and xi held."""
        change = self.surfaces(creep, NUDGE) - self.surfaces(creep, -NUDGE)
        return change @ self.contact.coefficients / (2 * NUDGE)

    def surface_changed(self, creep, change, gradient):
        """What the surface after a `Creep` changes with the pressure at a fixed x.

        gradient : the surface whose u is du/dx of this one
        """
        along, (b, width, centre) = self.surfaces(creep), (change[:-2], *change[-2:])
        tests, shift = self.contact.system.basis.tests, centre + width * self.x
        steeper = -tests @ (shift * self._values(gradient[:-1]))
        deeper = tests[0] @ (shift * self._values(along[:-1] @ self.contact.coefficients))
        return along @ b + width * self.widened(creep) + np.append(steeper, deeper)

    def _values(self, tested):
        """At the nodes, of a field tested with T_0 ... T_modes."""
        basis = self.contact.system.basis
        shapes = basis.tests / basis.tests[0] * (2 / basis.unit_test)
        return tested[0] / 2 * shapes[0] + tested[1:] @ shapes[1:]

    @cached_property
    def tangent(self):
        """What a change does to the surface less the roller; the last row is that of what is prescribed."""
        scene, contact = self.scene, self.contact
        tests, (slope, curvature) = contact.system.basis.tests, scene.slope(contact.centre + self.x)
        rows = np.zeros((len(tests) + 1, len(tests) + 1))
        rows[:, :-2] = self.surfaces(scene.ground.creep)
        rows[:, -2] = self.widened(scene.ground.creep)
        for column, shift in ((-2, self.x), (-1, 1.0)):
            rows[:-1, column] -= tests @ (shift * curvature)
            rows[-1, column] += tests[0] @ (shift * slope)
        if scene.target != "indentation":
            rows[-1] = self.kept
        return lu_factor(rows)

    @property
    def kept(self):
        """What a change does to the load or the peak pressure, each over its scale."""
        contact, kept = self.contact, np.zeros(len(self.contact.coefficients) + 2)
        if self.scene.target == "load":
            kept[0], kept[-2] = 1.0, 2 * contact.coefficients[0]
            return kept
        xi, alpha = contact.peak_place, contact.system.basis.trailing_exponent
        kept[:-2] = (
            galerkin_system.pressure_polynomials(xi, alpha, len(kept) - 2) * (1 - xi) ** (1 - alpha) * (1 + xi) ** alpha
        )
        kept[-2] = kept[:-2] @ contact.coefficients
        return kept

    def change(self, surface):
        """The change of the contact that makes up for what is added to the surface."""
        added = surface.copy()
        if self.scene.target != "indentation":
            added[-1] = 0.0
        return lu_solve(self.tangent, -added)

    @cached_property
    def pushed(self):
        """What a change does to the resistance."""
        contact, basis, friction = self.contact, self.contact.system.basis, self.scene.ground.friction
        x = contact.half_width * basis.seats
        slope, curvature = self.scene.slope(contact.centre + x)
        force, b = contact.scale * contact.half_width, contact.coefficients
        pushed = np.empty(len(b) + 2)
        pushed[:-2] = force * (basis.pressures @ slope)
        pushed[0] += force * friction * basis.unit_load
        pushed[-2] = 2 * contact.resistance + force * b @ (basis.pressures @ (x * curvature))
        pushed[-1] = force * b @ (basis.pressures @ curvature)
        return pushed
