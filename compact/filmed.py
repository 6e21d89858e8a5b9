"""Inside the layer while a roller moves over it: the fields of chosen instants of a path.

All nodes of the mesh keep their memory as those of the surface do, each line of nodes along itself, and are followed
from the forces on the surface alone, once the motion is known. The stress at an instant is that of the elastic layer
under the forces then; what has to be remembered is the displacement.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.compliance import stiffness
from compact.fields import lines_of, pictured, relaxed
from compact.material import Elastic
from compact.mesh import RowMesh
from compact.records import Layer
from compact.retained import fading_over, retained_by, steadily_retained
from compact.streamline import creep


@dataclass(frozen=True, eq=False)
class _Pushed:
    """A layer on a mesh under forces on the surface nodes, over the relaxed modulus [m], shape (2, n)."""

    mesh: RowMesh
    layer: Layer
    material: Elastic
    forces: np.ndarray
    speed: float = 1.0  # no force along x sums up on a layer that is held behind


def filmed(layer, material, mesh, path, way, velocity, times):
    """(time, meshio mesh) of the times, which are instants of the path.

    path : instants with `time`, `position`, `places` and `contact.forces`, the first in motion at `velocity` for ever
    way : positions of the roller at even instants from one time to another
    mesh : with its lines of nodes one above the other; ValueError otherwise

    The nodes move with the roller; `position` of the roller, a number of every cell, tells where on the layer they are.
    """
    if np.ptp(mesh.x, axis=0).max() > 1e-9 * mesh.height:
        raise ValueError("a film needs a `mesh` whose nodes stand one above the other; leave the mesh to `tolerance`")
    law = creep(material)
    basis = stiffness(mesh, material.poisson, layer).basis
    lines = lines_of(basis, mesh)
    x, places, taken = basis.doflocs[0][lines[0]], path[0].places, []

    def moved(instant):
        pushed = _Pushed(mesh, layer, material, instant.contact.forces)
        return pushed, relaxed(pushed)[lines].transpose(2, 0, 1)  # (2, lines, n)

    def taking(instant, pushed, w, z):
        u = np.empty((basis.N, 2))
        u[lines] = (law.instant * w + retained_by(law.shares, places, z, x + instant.position)).transpose(1, 2, 0)
        position = np.full(basis.nelems, instant.position)
        taken.append((instant.time, pictured(pushed, u, position=position)))

    pushed, w = moved(path[0])
    z = steadily_retained(law, x, w, velocity, places - path[0].position)
    if path[0].time in times:
        taking(path[0], pushed, w, z)
    for before, now in pairwise(instant for instant in path if instant.time <= max(times)):
        old, (pushed, w) = w, moved(now)
        step = fading_over(law, way(before.time, now.time), now.time - before.time)
        z = step.retained(x, places, z, old, w)
        if now.time in times:
            taking(now, pushed, w, z)
    return tuple(taken)
