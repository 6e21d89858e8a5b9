"""Exports: tables and a functional mock-up unit against the drive of the same scene.

A slow test validates the unit by fmpy, of the extra `full`.
"""

import ctypes
import json
import shutil
from dataclasses import replace
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from compact.analysis.study import Study
from compact.cli import program as cli
from compact.contact import dry_resistance
from compact.drive import Rigid, simulate
from compact.interfaces.force_tables import CartModel, force_table
from compact.interfaces.functional_mockup import VARIABLES, has_binary, write_fmu
from compact.motion import law
from compact.resistance import ResistanceMap
from compact.scene.loader import load_scene
from compact.turning import StrokeResistance, wave_shares

SMALL = "compact/data/scenes/small.toml"
REFERENCE = {each.name: number for number, each in enumerate(VARIABLES)}
SPEEDS = np.geomspace(0.01, 0.5, 6)
WITH_MEMORY = ResistanceMap(SPEEDS, 900 * SPEEDS**0.3, 0.0, None, -40 / (1 + SPEEDS), 0.1, return_ratio=0.6)


@pytest.fixture(scope="module")
def study(request):
    path = request.config.rootpath / SMALL
    changes = {"accuracy.engine": "column", "motion.laws": ["reversal-4"], "drive.turn": "step"}
    return Study(load_scene(path, **changes))


@pytest.fixture(scope="module")
def model(study):
    return CartModel.of(study)


@pytest.fixture(scope="module")
def model_with_memory(model):
    """The same cart on a layer with memory, whose return stroke is over compacted mix."""
    cart = replace(model.cart, return_load_ratio=0.5)
    return replace(model, cart=cart, resistance=WITH_MEMORY, largest_speed=0.5)


# functional mock-up unit


class PlainUnit:
    """Unit of a model by its functions of the standard, without the program that imports it."""

    def __init__(self, model, folder, **starts):
        if not any(map(shutil.which, ("cc", "gcc", "clang"))):
            pytest.skip("no compiler")
        write_fmu(model, folder / "cart.fmu")
        with ZipFile(folder / "cart.fmu") as archive:
            (library,) = (name for name in archive.namelist() if name.startswith("binaries/"))
            guid = ElementTree.fromstring(archive.read("modelDescription.xml")).get("guid").encode()
            self.library = ctypes.CDLL(archive.extract(library, folder))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        self.cart = ctypes.c_void_p(self.library.fmi2Instantiate(b"cart", 1, guid, None, None, 0, 0))
        self.set(**starts)
        assert self.library.fmi2ExitInitializationMode(self.cart) == 0

    def set(self, **values):
        for name, given in values.items():
            reference, number = ctypes.c_uint(REFERENCE[name]), ctypes.c_double(given)
            assert self.library.fmi2SetReal(self.cart, ctypes.byref(reference), 1, ctypes.byref(number)) == 0

    def get(self, name):
        reference, number = ctypes.c_uint(REFERENCE[name]), ctypes.c_double()
        assert self.library.fmi2GetReal(self.cart, ctypes.byref(reference), 1, ctypes.byref(number)) == 0
        return number.value

    def step(self, duration):
        assert self.library.fmi2DoStep(self.cart, ctypes.c_double(0.0), ctypes.c_double(duration), 0) == 0

    def close(self):
        self.library.fmi2FreeInstance(self.cart)


@pytest.mark.slow
def test_unit_is_valid_to_a_program_that_imports_it(model, tmp_path):
    path = write_fmu(model, tmp_path / "cart.fmu")
    assert has_binary(path) == any(map(shutil.which, ("cc", "gcc", "clang")))
    assert pytest.importorskip("fmpy.validation").validate_fmu(str(path)) == []


def test_unit_has_memory_and_return_stroke(model_with_memory, tmp_path):
    cart = PlainUnit(model_with_memory, tmp_path)
    for velocity in (-0.5, -0.1, -0.003, 0.003, 0.02, 0.49):  # below and above the slowest sample
        for acceleration in (-2.0, -0.01, 0.0, 0.02, 3.0):  # within and beyond the limit of the added-mass term
            cart.set(velocity=velocity, acceleration=acceleration)
            forces = model_with_memory.forces(velocity, acceleration)
            for name in ("resistance", "guide_friction"):
                assert cart.get(name) == pytest.approx(float(forces[name]), rel=1e-12)


def test_cart_of_the_unit_sticks_below_the_resistance_and_stops(model, tmp_path):
    cart = PlainUnit(model, tmp_path, start_velocity=0.1, start_position=0.2)
    holding = float(model.forces(1e-9, 0.0)["opposing_force"])  # below it creeps, as F falls with the speed
    cart.step(2.0)  # coasts to rest, and remains there
    stopped = cart.get("cart_position")
    assert cart.get("cart_velocity") == 0
    speeds = np.linspace(1e-6, 0.1, 2001)
    braking = model.forces(speeds, 0.0)["opposing_force"]
    distance = model.cart.mass * np.trapezoid(speeds / braking, speeds)  # m v dv = -F dx
    assert stopped - 0.2 == pytest.approx(distance, rel=1e-4)
    for force, moves in ((holding, False), (-holding, False), (1.5 * holding, True)):
        cart.set(applied_force=force)
        cart.step(0.1)
        assert (cart.get("cart_velocity") > 1e-3) == moves


def test_cart_that_stops_within_a_step_moves_on_in_the_rest_of_it(model, tmp_path):
    """Dry friction, by hand: v0/a to rest, and back with the smaller acceleration."""
    used = replace(model, resistance=dry_resistance(800.0))
    opposing = float(used.forces(1.0, 0.0)["opposing_force"])
    force, start, step, steps = -2 * opposing, 0.0123, 1e-3, 40
    unit = PlainUnit(used, tmp_path, applied_force=force, start_velocity=start)
    for _ in range(steps):
        unit.step(step)
    position, velocity = unit.get("cart_position"), unit.get("cart_velocity")
    unit.close()
    braking, returning = (force - opposing) / used.cart.mass, (force + opposing) / used.cart.mass
    left = step * steps + start / braking
    assert 0.1 < (start / -braking / step) % 1 < 0.9  # within a step
    assert velocity == pytest.approx(returning * left, rel=1e-9)
    assert position == pytest.approx(-(start**2) / 2 / braking + returning * left**2 / 2, rel=1e-9)


def along_stroke(resistance):
    near, far = (0.02, 2e-3, 2e-3, 0.2e-3, 0.110), (0.02, 2e-3, 1e-3, 0.2e-3, 0.154)
    shares = [share for pair in zip(wave_shares(*near), wave_shares(*far), strict=True) for share in pair]
    return StrokeResistance(resistance, *shares)


@pytest.mark.parametrize("memory", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_unit_follows_the_shares_along_the_stroke(model, model_with_memory, tmp_path, memory):
    """Its prescribed motion has the forces of the rigid drive, whose forces move its free cart by the law.

    From rest a mix of F ~ v^0.3 that pushes along the motion has many motions; there dry friction alone has one.
    """
    used = model_with_memory if memory else replace(model, resistance=dry_resistance(800.0))
    used = replace(used, resistance=along_stroke(used.resistance))
    cycle, steps = law("quintic", 0.4, 3.0).cycle(), 3000
    run = simulate(used.cart, Rigid(), cycle, used.resistance)
    dynamics, step = run.inverse_dynamics, cycle.period / steps
    phases = np.arange(steps // 2)[:, None] + (1e-9, 0.5)
    begun, middle = (
        [dynamics.state_at(leg, each / (steps // 2)) for leg in (*cycle.legs(), cycle.legs()[0])] for each in phases.T
    )
    moved = [np.concatenate([getattr(each, name) for each in begun]) for name in ("velocity", "acceleration")]
    forces, applied = (np.concatenate([each.forces.drive_force for each in states]) for states in (begun, middle))
    unit, gaps, positions, travels = PlainUnit(used, tmp_path), [], [], []
    for velocity, acceleration, force, push in zip(*moved, forces, applied, strict=True):
        unit.set(velocity=velocity, acceleration=acceleration, applied_force=push)
        gaps.append(unit.get("drive_force") - force)
        travels.append(unit.get("travel"))
        unit.step(step)
        positions.append(unit.get("cart_position"))
    assert np.abs(gaps[steps // 2 + 1 :]).max() < 0.02 * run.peak_force
    unit.close()
    returning = slice(steps // 2 + 20, steps - 20)
    exact = cycle.derivative(np.arange(steps) * step, 0)
    assert np.array(travels)[returning] == pytest.approx(0.4 - exact[returning], abs=1e-5)
    exact = cycle.derivative(np.arange(1, steps // 2 + 1) * step, 0)
    assert np.abs(positions[: steps // 2] - exact).max() < (2e-3 if memory else 2e-4) * 0.4


# tables


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
@pytest.mark.parametrize("memory", [False, True])
def test_table_meets_its_tolerance_against_the_drive(study, model, model_with_memory, memory, tolerance):
    used = model_with_memory if memory else model
    table, state = force_table(used, tolerance), study.stages.drive.runs["reversal-4"].state
    assert table.interpolation_error <= tolerance
    moving = np.abs(state.velocity) > np.min(np.abs(table.velocity[table.velocity != 0]))
    velocity, acceleration = state.velocity[moving], state.acceleration[moving]
    exact = used.forces(velocity, acceleration)["opposing_force"]
    linear = RegularGridInterpolator((table.velocity, table.acceleration), table.forces["opposing_force"])
    found = linear(np.column_stack([velocity, acceleration]))
    assert np.max(np.abs(found - exact)) <= tolerance * np.max(np.abs(exact))


# command


def test_command_writes_table_and_unit(request, tmp_path, capsys):
    scene = str(request.config.rootpath / SMALL)
    formats = ["--format", "csv", "fmu"]
    assert cli._exit_code(["export", scene, *formats, "--out", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {path.rpartition("/")[2] for path in found["files"]} == {"force.csv", "cart.fmu"}
    assert found["mass"] == 1000
