"""Layers of plies: surface compliance against mpmath, limits, comparison of the engines "spectral" and "fem"."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rolling_scenes import HEIGHT as H
from rolling_scenes import MIX, SLS, R
from rolling_scenes import roll_elements as roll
from sampling import examples
from scipy.sparse.linalg import spsolve

from compact import fem, mesh
from compact.engines.fem import compliance
from compact.engines.spectral import engine as spectral
from compact.engines.spectral.engine import contact_of_half_width
from compact.engines.spectral.galerkin_system import compliance_deviation
from compact.material.laws import Viscoelastic
from compact.numerics import assembly
from compact.rolling_contact import Layer, Ply, Roller

PRESSED = Roller(R, indentation=0.003)


def two_plies(depth, jump, base="bonded"):
    """Two plies; the upper one has the thickness `depth` [m] and the relative stiffness `jump`."""
    return Layer(H, base=base, plies=(Ply(thickness=H - depth, stiffness=1.0), Ply(thickness=depth, stiffness=jump)))


# surface compliance


def fourier_modes(wave_number, layer, poisson):
    """L and M from the 4x4 system of one Fourier mode, (U, V, T, S) of (i u_x, u_y, i s_xy, s_yy) integrated over y."""
    nu, transfer = mpmath.mpf(poisson), mpmath.eye(4)
    for ply in layer.stack:
        G = mpmath.mpf(ply.stiffness)
        lame = 2 * G * nu / (1 - 2 * nu)
        stiff = lame + 2 * G
        rates = mpmath.matrix(
            [
                [0, -1, 1 / G, 0],
                [lame / stiff, 0, 0, 1 / stiff],
                [stiff - lame**2 / stiff, 0, 0, -lame / stiff],
                [0, 0, 1, 0],
            ]
        )
        transfer = mpmath.expm(rates * mpmath.mpf(wave_number) * mpmath.mpf(ply.thickness)) * transfer
    unknown = (2, 3) if layer.base == "bonded" else (0, 3)
    tractions = mpmath.matrix([[transfer[row, col] for col in unknown] for row in (2, 3)])
    depth = mpmath.matrix([[transfer[1, col] for col in unknown]]) * tractions**-1
    return G / (1 - nu) * depth[1], -G / (1 - nu) * depth[0]


@pytest.mark.sampled(24)
@pytest.mark.parametrize("base", ["bonded", "slip"])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.4999])
@pytest.mark.parametrize(
    "plies",
    [
        (),
        (Ply(thickness=0.8, stiffness=1.0), Ply(thickness=0.2, stiffness=20.0)),
        (Ply(thickness=0.8, stiffness=20.0), Ply(thickness=0.2, stiffness=1.0)),
        (Ply(thickness=0.6, stiffness=3.0), Ply(thickness=0.1, stiffness=60.0), Ply(thickness=0.3, stiffness=1.0)),
    ],
    ids=["one", "stiff-above", "soft-above", "three"],
)
@pytest.mark.parametrize("zeta", [1e-3, 1.0, 12.0])
def test_compliance_agrees_with_the_fourier_mode(zeta, plies, poisson, base):
    layer = Layer(1.0, base=base, plies=plies)
    with mpmath.workdps(60):
        L, M = fourier_modes(zeta, layer, poisson)
        b = (1 - 2 * mpmath.mpf(poisson)) / (2 - 2 * mpmath.mpf(poisson))
        expected = float(L - 1), float(M - b)
    normal, shear = compliance_deviation(np.array([zeta]), layer, poisson)
    assert (normal[0], shear[0]) == pytest.approx(expected, rel=1e-11, abs=1e-13)


layers = st.builds(
    lambda base, plies: Layer(sum(ply.thickness for ply in plies), base=base, plies=plies),
    st.sampled_from(["bonded", "slip"]),
    st.lists(st.builds(Ply, thickness=st.floats(0.01, 1), stiffness=st.floats(0.05, 20)), min_size=1, max_size=4),
)
waves = np.geomspace(1e-7, 1e3, 41)


@given(layers, st.floats(0, 0.49), st.floats(1.1, 10))
def test_stiffer_lower_ply_reduces_the_compliance(layer, poisson, factor):
    soft = Layer(layer.height + 0.5, base=layer.base, plies=(Ply(thickness=0.5, stiffness=1.0), *layer.plies))
    hard = Layer(layer.height + 0.5, base=layer.base, plies=(Ply(thickness=0.5, stiffness=factor), *layer.plies))
    assert np.all(
        compliance_deviation(waves, hard, poisson)[0] <= compliance_deviation(waves, soft, poisson)[0] + 1e-10
    )
    assert np.all(compliance_deviation(waves, soft, poisson)[0] >= -1)


# closed forms


@given(layers, st.floats(0, 0.49))
def test_long_waves_compress_the_plies_in_series(layer, poisson):
    """A bonded stack has the compliance sum d/(c M); without friction at the base it stretches freely."""
    d = np.array([ply.thickness for ply in layer.stack])
    c = np.array([ply.stiffness for ply in layer.stack])
    contact_modulus, oedometer = 1 / (1 - poisson**2), (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    displacement = np.sum(d / c) / oedometer
    if layer.base == "slip":
        sideways = poisson / (1 - poisson)
        displacement += sideways**2 * d.sum() ** 2 / (contact_modulus * np.sum(c * d))
    k = 1e-3 / layer.height
    L = 1 + compliance_deviation(np.array([k]), layer, poisson)[0][0]
    assert L * 2 / (contact_modulus * c[-1]) / k == pytest.approx(displacement, rel=1e-3)


@given(layers, st.floats(0, 0.49))
def test_traction_stretches_plies_on_a_frictionless_base_equally(layer, poisson):
    """Far behind, the stretched stack is thinner: M = -c_top H nu/(2 (1 - nu) sum c d)."""
    b, far = (1 - 2 * poisson) / (2 - 2 * poisson), 0.0
    if layer.base == "slip":
        spread = sum(ply.stiffness * ply.thickness for ply in layer.stack)
        far = -poisson / (2 - 2 * poisson) * layer.height * layer.stack[-1].stiffness / spread
    assert b + compliance_deviation(0.0, layer, poisson)[1] == pytest.approx(far, abs=1e-6)


SERIES = Ply(thickness=0.1, stiffness=20.0), Ply(thickness=0.07, stiffness=1.0), Ply(thickness=0.05, stiffness=5.0)


@pytest.mark.parametrize("layer", [Layer(H), Layer(H, plies=SERIES)], ids=["one", "three"])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_confined_plies_are_oedometers_in_series(poisson, layer):
    rows = mesh.graded_mesh(H, 0.02, 4, interfaces=layer.interfaces)
    basis = compliance.layer_stiffness(rows, poisson, layer).basis
    K = assembly.assemble_stiffness(basis, compliance.element_moduli(rows, poisson, layer))
    x, y = basis.doflocs
    free, surface = np.flatnonzero(y > 1e-12), np.flatnonzero(y > H * (1 - 1e-12))
    surface = surface[np.argsort(x[surface])]
    load, sizes = np.zeros(basis.N), np.diff(x[surface][::2])
    for place, share in ((0, 1), (1, 4), (2, 1)):
        np.add.at(load, surface[place : place + 2 * len(sizes) - 1 : 2], -share * sizes / 6)
    displacement = spsolve(K[1::2, 1::2][free][:, free].tocsc(), load[free])
    series = sum(ply.thickness / ply.stiffness for ply in layer.stack)
    exact = series * (1 + poisson) * (1 - 2 * poisson) / (1 - poisson)
    assert -displacement[y[free] > H * (1 - 1e-12)] == pytest.approx(exact, rel=1e-9)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("base", ["bonded", "slip"])
def test_plies_of_one_stiffness_equal_one_layer(base):
    roller = Roller(R, indentation=0.003, friction=0.2, rolling="sliding")
    one = Layer(H, base=base), roller, Viscoelastic(youngs_modulus=30e6, poisson=0.3, branches=SLS.branches), 0.03
    two = (
        Layer(H, base=base, plies=(Ply(thickness=H / 2, stiffness=3.0), Ply(thickness=H / 2, stiffness=3.0))),
        roller,
        SLS,
        0.03,
    )
    rows = mesh.graded_mesh(H, 0.0138, 2, interfaces=two[0].interfaces, growth=1.7)
    for engine, numerics in ((spectral, {"rtol": 1e-8}), (fem, {"mesh": rows})):
        whole, parts = (engine.roll(*case, **numerics) for case in (one, two))
        assert (parts.load, parts.resistance) == pytest.approx((whole.load, whole.resistance), rel=1e-10)
        assert parts.work_residual == pytest.approx(whole.work_residual, abs=1e-7)


@pytest.mark.parametrize("base", ["bonded", "slip"])
def test_rigid_lower_ply_is_a_bonded_base(base):
    top = spectral.roll(Layer(0.05), PRESSED, SLS, 0.03)
    for hard, deviation in ((1e3, 3e-3), (1e6, 3e-6)):
        layer = Layer(H, base=base, plies=(Ply(thickness=H - 0.05, stiffness=hard), Ply(thickness=0.05, stiffness=1.0)))
        rolled = spectral.roll(layer, PRESSED, SLS, 0.03)
        assert (rolled.load, rolled.resistance) == pytest.approx((top.load, top.resistance), rel=deviation)
    rolled = roll(layer, PRESSED, SLS, 0.03)
    assert rolled.load == pytest.approx(top.load, rel=1e-4)
    assert rolled.resistance == pytest.approx(top.resistance, rel=1e-3)


# comparison of the engines with stiffness ratios of 20 at several depths of the interface


def assert_engines_agree(layer, roller, material, speed, load=5e-4, resistance=5e-3):
    exact, rolled = spectral.roll(layer, roller, material, speed, rtol=1e-6), fem.roll(layer, roller, material, speed)
    assert rolled.load == pytest.approx(exact.load, rel=load)
    assert rolled.indentation == pytest.approx(exact.indentation, rel=load)
    assert rolled.resistance == pytest.approx(exact.resistance, rel=resistance)
    assert rolled.peak_pressure == pytest.approx(exact.peak_pressure, rel=0.01)
    assert max(rolled.work_residual, exact.work_residual) < 5e-3
    assert rolled.error[0] < 2 * load
    assert rolled.error[1] < 2 * resistance


SHEET = Ply(thickness=0.2, stiffness=1.0), Ply(thickness=0.001, stiffness=50.0), Ply(thickness=0.019, stiffness=1.0)
JUMPS = {"stiff-above": 20.0, "soft-above": 1 / 20}
AGREEMENTS = {  # layer and target; the default tolerance of a peak pressure is half a percent, the forces follow it
    **{
        f"{depth} {base} {name}": (two_plies(depth * 0.01, jump, base), "indentation", {})
        for depth, base in ((1.0, "bonded"), (0.2, "bonded"), (0.2, "slip"), (7.0, "slip"))
        for name, jump in JUMPS.items()
    },
    "sheet": (Layer(H, plies=SHEET), "indentation", {}),
    **{f"load {name}": (two_plies(0.002, jump), "load", {}) for name, jump in JUMPS.items()},
    **{
        f"peak {name}": (two_plies(0.002, jump), "peak_pressure", {"load": 5e-3, "resistance": 1e-2})
        for name, jump in JUMPS.items()
    },
}


@pytest.mark.parametrize(
    "case", [pytest.param(name, marks=[pytest.mark.slow] * (place > 0)) for place, name in enumerate(AGREEMENTS)]
)
def test_engines_agree_for_plies(case):
    layer, target, tolerances = AGREEMENTS[case]
    roller = (
        PRESSED
        if case == "sheet"
        else Roller(R, **{target: getattr(contact_of_half_width(layer, MIX, R, 0.01), target)})
    )
    assert_engines_agree(layer, roller, SLS, 0.01, **tolerances)


# balances


@examples(3, slow=4)
@given(
    st.lists(st.builds(Ply, thickness=st.floats(0.02, 0.2), stiffness=st.floats(0.05, 20)), min_size=2, max_size=3),
    st.sampled_from(["bonded", "slip"]),
    st.sampled_from(["frictionless", "sliding", "free"]),
    st.floats(-2.5, -0.5),
)
def test_energy_balance_on_random_plies(plies, base, rolling, decade):
    layer = Layer(sum(ply.thickness for ply in plies), base=base, plies=plies)
    roller = Roller(R, indentation=0.003, friction=0.3, rolling=rolling, profile="deformed")
    rolled = roll(layer, roller, SLS, 10**decade)
    assert rolled.work_residual < 5e-3
    assert rolled.pressure.min() > -2e-3 * rolled.peak_pressure


def test_fields_of_plies_balance_load_and_work():
    layer = two_plies(0.01, 20.0)
    rolled = roll(layer, PRESSED, SLS, 0.03)
    content = fem.fields(rolled)
    corners = content.points[content.cells[0].data[:, :4]]
    width, height = np.ptp(corners[:, :, 0], axis=1), np.ptp(corners[:, :, 1], axis=1)
    work = (width * height) @ content.cell_data["dissipation"][0] / 0.03
    assert work == pytest.approx(rolled.resistance, rel=5e-3)
    relaxed = fem.fields(roll(layer, PRESSED, MIX, 1.0, mesh=rolled.mesh))
    transfer = (width * relaxed.cell_data["stress"][0][:, 1]).reshape(rolled.mesh.shape).sum(axis=1)
    assert -transfer == pytest.approx(transfer[0] * -np.ones(len(transfer)), rel=1e-6)
    assert -transfer[0] == pytest.approx(roll(layer, PRESSED, MIX, 1.0, mesh=rolled.mesh).load, rel=1e-6)


def test_stress_along_x_jumps_with_the_stiffness_at_an_interface():
    """s_xx = c E* e_xx + nu/(1 - nu) s_yy with continuous e_xx and s_yy; the bent crust is stretched below."""
    layer = two_plies(0.01, 20.0)
    rows = mesh.graded_mesh(H, 0.0138, 10, interfaces=layer.interfaces, growth=1.25)
    content = fem.fields(roll(layer, PRESSED, MIX, 1.0, mesh=rows))
    x, y = content.points[content.cells[0].data[:, 8], :2].T
    column = np.flatnonzero(x == x[x > 0].min())
    bed, crust = (
        np.polyfit(y[side] - H + 0.01, content.cell_data["stress"][0][side, :2], 2)[2]
        for side in (column[y[column] < H - 0.01][-3:], column[y[column] > H - 0.01][:3])
    )
    assert crust[1] == pytest.approx(bed[1], rel=0.05)
    stretch = [stress[0] - 0.3 / 0.7 * stress[1] for stress in (bed, crust)]
    assert stretch[1] == pytest.approx(20 * stretch[0], rel=0.05)
    assert crust[0] > 0 > bed[0]


@pytest.mark.slow
def test_load_on_plies_converges():
    layer, loads = two_plies(0.005, 20.0), []
    rows = mesh.graded_mesh(H, 0.008, 2, interfaces=layer.interfaces, growth=1.7)
    for _ in range(3):
        loads.append(roll(layer, PRESSED, MIX, 1.0, mesh=rows).load)
        rows = rows.refined()
    exact = spectral.roll(layer, PRESSED, MIX, 1.0, rtol=1e-8).load
    order = -np.polyfit(range(3), np.log2(np.abs(np.array(loads) - exact)), 1)[0]
    assert order >= 2, f"observed order of the load {order:.2f}"


@given(layers, st.floats(0, 0.49), st.integers(0, 3), st.floats(0.1, 0.9))
def test_dividing_a_ply_leaves_the_compliance_unchanged(layer, poisson, which, share):
    which %= len(layer.stack)
    ply = layer.stack[which]
    moduli = [ply.stiffness for ply in layer.stack]
    rounding = min(1e-10 * max(moduli) / min(moduli), 2e-8)  # grows with the contrast; 7e-9 in 4000 random layers
    halves = (
        Ply(thickness=ply.thickness * share, stiffness=ply.stiffness),
        Ply(thickness=ply.thickness * (1 - share), stiffness=ply.stiffness),
    )
    cut = Layer(layer.height, base=layer.base, plies=(*layer.plies[:which], *halves, *layer.plies[which + 1 :]))
    for whole, parts in zip(
        compliance_deviation(waves, layer, poisson), compliance_deviation(waves, cut, poisson), strict=True
    ):
        assert parts == pytest.approx(whole, abs=rounding)
