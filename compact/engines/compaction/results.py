"""What rolling over compacting mix gives: forces, contact, the mix that leaves, and whether the numbers may be trusted.

mass    grains and water of the column that leaves = those of the column that was fed, both at rest (`Fed.solid`)
work    resistance = sum of W dY + int t (slip velocity) dx/v,    W = int J sigma : d strain of the mix that leaves
"""

from dataclasses import dataclass

import numpy as np

from compact.engines.compaction.finite_strain_solid import STATE
from compact.engines.compaction.roller_frame import LayerState
from compact.material import cap_plasticity
from compact.numerics.assembly import unit_moduli
from compact.rolling_contact import ContactResult, Layer, Roller

ITERATIONS = 2100  # of the mix that leaves, towards its rest: one as a rule, hundreds where it yields on the way
SURE = 2000  # of them as if it were elastic, which always come nearer; then by its own slope, which may overshoot
ELASTIC = 1e-4  # of the elastic stiffness, beside that of mix which yields and may have none
FREE = 1e-9  # of the unloading modulus, what horizontal planes may still bear then


@dataclass(frozen=True)
class CompactionContactResult(ContactResult):
    """A `ContactResult` over compacting mix.

    indentation : fed height less that of the lowest generatrix [m]
    creep : angular speed x radius/speed - 1 of a roller that sticks and slips, else None
    exit : mix that leaves, by rows from the base up, a `LayerState` for the next pass;  exit_height : its surface [m]
    exit_density_ratio : its mean over the height;  spring_back : rise behind the lowest generatrix [m]
    bow_wave : rise of the surface in front of the roller above the fed height [m]
    peak_density_ratio : the largest anywhere;  over_pressed : it is more than 1
    mass_residual, equilibrium_residual : relative;  yield_residual : largest stress beyond the cap over its pressure
    steps : of the march, a tuple of `Step`;  march : its last state, from which a neighbour starts
    """

    indentation: float = 0.0
    creep: float | None = None
    exit: LayerState | None = None
    exit_height: float = 0.0
    exit_density_ratio: float = 0.0
    spring_back: float = 0.0
    bow_wave: float = 0.0
    peak_density_ratio: float = 0.0
    mass_residual: float = 0.0
    equilibrium_residual: float = 0.0
    yield_residual: float = 0.0
    steps: tuple = ()
    march: object = None
    layer: Layer | None = None
    roller: Roller | None = None
    material: object = None
    speed: float = 0.0

    @property
    def over_pressed(self):
        """Whether the mix passes full density somewhere, beyond what its law knows."""
        return self.peak_density_ratio > 1


def build_result(march, layer, roller, material, speed):
    """The `CompactionContactResult` of a `March` that is steady."""
    frame, condition, last = march.frame, march.condition, march.steps[-1]
    law, way = frame.solid.law, 1.0 if speed > 0 else -1.0
    x, pressure, shear, trailing, leading = _contact(march)
    _refuse_skid(march)
    leaving, length = left(frame, condition, frame.exit)
    return CompactionContactResult(
        load=last.load,
        resistance=way * last.resistance,
        leading=leading,
        trailing=trailing,
        x=x if way > 0 else -x[::-1],
        pressure=pressure if way > 0 else pressure[::-1],
        shear_traction=shear if way > 0 else -shear[::-1],
        work_residual=work_residual(march),
        peak_pressure=float(pressure.max()),
        indentation=layer.height - last.lowest,
        creep=march.push.creep,
        exit=leaving,
        exit_height=leaving.height,
        exit_density_ratio=leaving.density_ratio,
        spring_back=leaving.height - last.lowest,
        bow_wave=float(max(march.places[:, 1].max() - layer.height, 0.0)),
        peak_density_ratio=float(condition.state.density_ratio.max()),
        mass_residual=abs(leaving.solid(law) * length / frame.fed.solid(law) - 1),
        equilibrium_residual=last.residual,
        yield_residual=_yield_residual(frame.solid, condition.state),
        steps=march.steps,
        march=march,
        layer=layer,
        roller=roller,
        material=material,
        speed=speed,
    )


def fields(rolled):
    """Displacement, density ratio, plastic work, pressure and stress of a `CompactionContactResult`, a meshio mesh of 8-node
    quadrilaterals on the fed layer as it lies under the roller.

    point data : displacement [m], 3 components
    cell data, means of the elements : stress (xx, yy, zz, xy, yz, xz) [Pa], tension positive; pressure, of all
    directions [Pa], compression positive; density_ratio; plastic_work [J/m3]
    """
    return drawn(rolled.march.frame, rolled.march.condition, 1.0 if rolled.speed > 0 else -1.0)


def drawn(frame, condition, way=1.0):
    """The meshio mesh of `fields`, mirrored where the way is -1."""
    import meshio

    mirror = np.array([way, 1.0])
    state, count = condition.state, frame.solid.basis.nelems
    stress = np.zeros((count, 6))
    stress[:, :4] = state.stress.reshape(count, -1, 4).mean(axis=1) * [1, 1, 1, mirror[0]]
    numbers = {name: getattr(state, name).reshape(count, -1).mean(axis=1) for name in ("density_ratio", "plastic_work")}
    cells = {"stress": stress, "pressure": -stress[:, :3].mean(axis=1), **numbers}
    return meshio.Mesh(
        np.pad(frame.nodes * mirror, ((0, 0), (0, 1))),
        [("quad8", frame.solid.basis.element_dofs.T)],
        point_data={"displacement": np.pad(condition.displacement * mirror, ((0, 0), (0, 1)))},
        cell_data={name: [values] for name, values in cells.items()},
    )


def work_residual(march):
    """What the roller gives less what the mix keeps and what slip takes, over the resistance."""
    frame, face, (load, resistance) = march.frame, march.face, march.forces()
    kept = frame.row_heights @ frame.rows(march.condition.work)[:, frame.exit]
    slip = np.array([1.0, 0.0]) - march.change[frame.surface] / frame.step  # of the roller on the mix, over the speed
    rubbed = np.sum(face.tangent(march.condition.displacement[frame.surface]) * slip, axis=1)
    # what the turning gives, - (1 + creep) times the sum of the shear, it takes off the slip
    lost = np.sum(face.weight * march.push.shear * rubbed)
    return float(abs(resistance - kept - lost) / max(abs(resistance), 1e-3 * load))


def _refuse_skid(march):
    """A torque beyond what friction holds slips all over, and nothing tells how fast."""
    if march.push.creep is None:
        return
    asked = march.face.asked(march.push)
    if asked >= 1:
        raise RuntimeError(f"the roller skids: {asked:.3g} times the friction limit asked")


def _contact(march):
    """x, pressure and shear along the contact, and its edges, half-way to the first node that is free."""
    touching = np.flatnonzero(march.push.pressure > 0)
    x = march.places[:, 0]
    if not len(touching):
        raise RuntimeError("the roller does not touch the layer")
    first, last = touching[0], touching[-1]
    if first == 0 or last == len(x) - 1:
        raise RuntimeError(
            f"the contact reaches the end of the mesh, from {x[first]:.3g} to {x[last]:.3g} m; press less deep"
        )
    trailing, leading = (x[first - 1] + x[first]) / 2, (x[last] + x[last + 1]) / 2
    inside = slice(first, last + 1)
    return (
        np.concatenate([[trailing], x[inside], [leading]]),
        *(np.concatenate([[0.0], traction[inside], [0.0]]) for traction in (march.pressure, march.shear)),
        float(trailing),
        float(leading),
    )


def left(frame, condition, column):
    """The mix of a column of points as the next `LayerState`, and its length over that as it was fed.

    Far behind the roller the layer is the same all along x: no stress is left on horizontal planes, and what is bonded
    is as long as it was fed. A layer that slips keeps the force along x that it has, none.
    """
    state = cap_plasticity.MaterialPoint(*(frame.rows(getattr(condition.state, name))[:, column] for name in STATE))
    along = frame.rows(frame.solid.gradient(condition.displacement)[:, 0])[:, column]
    if along.min() <= -1:
        raise RuntimeError("the mix that leaves is folded over along the travel; press less deep")
    stretch = np.log1p(along)
    area = frame.row_heights * frame.rows(_volume(frame.solid, condition.displacement))[:, column]
    mean = area @ stretch / area.sum() if frame.slips else 0.0
    rest, volume = _at_rest(frame.solid, state, mean - stretch)
    return LayerState(area * volume * np.exp(-mean), rest), float(np.exp(mean))


def _at_rest(solid, state, stretch):
    """Rows of mix that are strained by so much along x, and across until their horizontal planes are free of stress.

    Returns their `MaterialPoint` and volume over that before.
    """
    strain = np.zeros((len(stretch), 3))
    strain[:, 0] = stretch
    law = solid.law
    two_shear, _, shear, lame = law.unloading_modulus * unit_moduli(law.poisson)
    elastic = np.diag([two_shear + lame, shear])
    for iteration in range(ITERATIONS):
        rest, slopes = cap_plasticity.integrate_points(law, state, strain, solid.rate_factor, tangent=iteration >= SURE)
        if np.abs(rest.stress[:, [1, 3]]).max() < FREE * law.unloading_modulus:
            rest.stress[:, [1, 3]] = 0.0
            return rest, np.exp(strain[:, 0] + strain[:, 1])
        slope = elastic if slopes is None else slopes[:, 1:, 1:] + ELASTIC * elastic
        strain[:, 1:] -= np.linalg.solve(slope, rest.stress[:, [1, 3], None])[..., 0]
    raise RuntimeError(
        f"the mix that leaves does not come to rest: it still bears {np.abs(rest.stress[:, [1, 3]]).max():.3g} Pa on "
        f"horizontal planes after {ITERATIONS} iterations; press less deep"
    )


def _volume(solid, displacement):
    """J of the points; of linear kinematics 1 plus the change of area."""
    gradient = solid.gradient(displacement)
    if solid.finite:
        return (1 + gradient[:, 0]) * (1 + gradient[:, 3]) - gradient[:, 1] * gradient[:, 2]
    return 1 + gradient[:, 0] + gradient[:, 3]


def _yield_residual(solid, state):
    """Largest elastic overshoot beyond the cap: the stress that one more step at rest would give up, over pc."""
    rest, _ = cap_plasticity.integrate_points(
        solid.law, state, np.zeros((len(state.stress), 3)), solid.rate_factor, tangent=False
    )
    pc = solid.law.yield_pressure(state.max_density_ratio) * solid.rate_factor
    return float((np.abs(rest.stress - state.stress).max(axis=1) / pc).max())
