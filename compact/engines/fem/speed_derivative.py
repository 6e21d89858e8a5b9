"""Slow changes of speed in the engine "fem": dF_ss/dv and M.

Seen from the roller what a creep branch retains of the surface, see `streamline`, follows

    z + theta (dz/dt - v dz/dx) = w,    u = J_0 w + sum J_k z_k,

w the displacement of the elastic layer. While dv/dt = a is small d/dt is a d/dv, z = z_ss + a z_1, and with the memory
m of a length v theta, z_ss = m w_ss,

    z_1 = m (w_1 - theta dz_ss/dv),    u = C K p - a g,    g = sum J_k theta_k m_k dz_k/dv.

So the roller in slow acceleration meets the layer in steady motion on a surface that stands a g aside: M follows from
two contacts with that, as dF_ss/dv and dz_ss/dv do from a speed a little lower and a little higher. All these contacts
lie alike on their meshes, which are those of the steady one shifted and stretched along x. Where a mesh stays at rest,
edges that pass its nodes add errors to the derivatives that are ten times those of F_ss.
"""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.fem import engine as fem_engine
from compact.engines.fem.contact_patch import RollAside, Surface
from compact.engines.fem.convected_memory import creep, memory, retardation
from compact.mesh import DEFAULT_ERROR
from compact.resistance import ResistanceExpansion

# On a mesh that the contact takes along: dF_ss/dv and M within 0.07 % to an instant/relaxed of 20, M over the larger of
# |M| and tau dF_ss/dv.
TOLERANCE = DEFAULT_ERROR
FASTER = 1e-3  # relative change of the speed either way
ASIDE = 1e-3  # how far the surface is set aside either way at most, over the indentation
ROUNDS = 3  # of a contact and its mesh
CAUTION = 2.0  # times the difference from the refined solution
LUCK = 1e-3  # of the larger of |M| and |tau dF_ss/dv|: for differences that are small by luck


def modulation(layer, roller, material, speed, *, mesh=None, tolerance=TOLERANCE, estimate=True):
    """The `ResistanceExpansion` of a roller on a linear layer, of every profile, without friction or sliding.

    layer, roller, material, speed, mesh, tolerance : as of `fem_engine.roll`, the tolerance being that of F_ss
    estimate : whether to tell the error of M, by another solution on a mesh refined once

    What sticks and slips depends on how fast the surface moves under the roller, which the surface alone does not tell;
    it is refused.
    """
    fem_engine.require_linear_range(layer, roller, material, speed, mesh, tolerance)
    case = fem_engine.Case(layer, roller, material, speed)
    if case.sticks:
        raise ValueError(
            f"M is known without stick only, got `rolling` '{roller.rolling}' with `friction` {roller.friction!r}; "
            "use 'sliding' or no friction"
        )
    branches = getattr(material, "branches", ())
    if not branches:
        rolled = fem_engine.roll(layer, roller, material, speed, mesh=mesh, tolerance=tolerance, estimate=False)
        return ResistanceExpansion(speed, rolled.resistance, slope=0.0, added_mass=0.0, error=0.0, relaxation_time=0.0)
    time = max(time for _, time in branches)
    with threadpool_limits(1):  # matrices are small, threads only quarrel
        task = fem_engine.task_of(case, mesh, tolerance) if mesh else fem_engine.fitted_task(case, tolerance)
        resistance, slope, added_mass = _followed(case, task)
        error = None
        if estimate:
            finer = replace(task, mesh=task.mesh.refined(), terms=task.terms + fem_engine.JUDGES_TERMS)
            judged = _followed(case, finer)[2]
            error = CAUTION * abs(added_mass - judged) + LUCK * max(abs(judged), time * abs(slope))
    return ResistanceExpansion(speed, resistance, slope, added_mass, error, time)


def _followed(case, task):
    """(F_ss, dF_ss/dv, M) of a case, in a loaded zone that holds all of its contacts."""
    return fem_engine.widening(task, lambda window: _followed_within(case, task, window))


def _followed_within(case, task, window):
    """The same in the loaded zone |x| <= window, whose mesh every contact takes along with its own edges."""
    steady = _contact(case, task, window)
    task = replace(task, depth=steady.roll.indentation)
    taken = _Taken(
        fem_engine.elastic_surface(case, task.mesh, window),
        fem_engine.stretched_surface(case, task.mesh, window),
        steady,
        task,
    )
    slower, faster = (replace(case, speed=case.speed * (1 + side * FASTER)) for side in (-1, 1))
    before, after = (taken.contact(each) for each in (slower, faster))
    apart = faster.speed - slower.speed
    w, z = taken.displaced(steady), taken.retained(case, steady)
    change = (taken.retained(faster, after) - taken.retained(slower, before)) / apart
    moving = (after.surface.x - before.surface.x) / apart
    lengths = case.speed * np.array(creep(case.material).times)[:, None, None]
    surface = steady.surface
    late = _late(case, surface.x, change - moving * (z - w) / lengths)  # at a given x, since z - l dz/dx = w
    reach = float(ASIDE * task.depth / np.abs(late[:, surface.first : surface.last]).max())
    losing, gaining = (
        taken.contact(_SetAside(**vars(case), nodes=surface.x, aside=-acceleration * late))
        for acceleration in (-reach, reach)
    )
    modulus = case.material.youngs_modulus
    pushed = [float(modulus * contact.force[0]) for contact in (steady, before, after, losing, gaining)]
    return pushed[0], (pushed[2] - pushed[1]) / apart, (pushed[4] - pushed[3]) / (2 * reach)


def _contact(case, task, window, start=None):
    return fem_engine.at_target(case, fem_engine.surface_of(case, task.mesh, window), task, start=start)


@dataclass(frozen=True)
class _Taken:
    """Contacts near a steady one, on its mesh shifted and stretched along x so that their edges lie on it alike.

    What the mesh does to the resistance then hardly changes from one to the next. It would with the place of the edges
    in their elements, and derivatives feel that ten times as much as the resistance.

    elastic : the `Surface` of the elastic layer;  stretched : the derivative of its response by the stretch
    """

    elastic: Surface
    stretched: Surface
    steady: fem_engine.Contact
    task: object

    def contact(self, case):
        """The contact of a case."""
        near, edges = self.steady, self.steady.patch.edges
        for _ in range(ROUNDS):
            stretch = np.subtract(*near.patch.edges) / np.subtract(*edges)
            x = near.patch.trailing + stretch * (self.elastic.x - edges[0])
            C = retardation(x, case.material, case.speed)
            response = np.einsum("ca,iakb->ickb", C, self._response(stretch), optimize=True)
            near = fem_engine.at_target(case, replace(self.elastic, x=x, response=response), self.task, start=near)
        return near

    def _response(self, stretch):
        return self.elastic.response + np.log(stretch) * self.stretched.response

    def displaced(self, contact):
        """w of the elastic layer under a contact, shape (2, n)."""
        x, first, last = self.elastic.x, self.elastic.first, self.elastic.last
        stretch = np.ptp(contact.surface.x) / np.ptp(x)
        return np.einsum("iakb,kb->ia", self._response(stretch), contact.forces[:, first:last], optimize=True)

    def retained(self, case, contact):
        """z_k of every branch of a contact, shape (branches, 2, n)."""
        w, x = self.displaced(contact), contact.surface.x
        return np.array([w @ memory(x, time * case.speed).T for time in creep(case.material).times])


def _late(case, x, change):
    """g by the change of z_k with speed, shape (2, n)."""
    law = creep(case.material)
    branches = zip(law.shares, law.times, change, strict=True)
    return sum(share * time * each @ memory(x, time * case.speed).T for share, time, each in branches)


@dataclass(frozen=True)
class _SetAside(fem_engine.Case):
    """A case whose surface stands aside, at `nodes` [m] by `aside` [m], shape (2, n)."""

    nodes: np.ndarray | None = None
    aside: np.ndarray | None = None

    def pressed(self, indentation):
        return RollAside(**vars(super().pressed(indentation)), nodes=self.nodes, aside=self.aside)
