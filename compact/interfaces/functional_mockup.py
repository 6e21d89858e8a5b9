"""Functional mock-up unit (FMI 2.0, co-simulation) of a cart with the resistance of its mix.

    write_fmu(CartModel.of(study), "cart.fmu")

The unit contains the sources in C and, where a compiler is found, the binary for this platform. The program that
imports it needs neither Python nor this package; other platforms compile the sources (`fmpy compile cart.fmu`). Its
functions are those of `compact.resistance` and `compact.machine.cart`, not a table: the numbers agree to rounding.

| variable | unit | role |
|---|---|---|
| `velocity`, `acceleration` | m/s, m/s2 | inputs: prescribed motion |
| `resistance`, `guide_friction`, `drive_force` | N | outputs for it; drive force = mass * acceleration + both |
| `applied_force` | N | input: force of a drive on a cart that moves freely |
| `cart_position`, `cart_velocity`, `cart_acceleration` | m, m/s, m/s2 | outputs for this force |
| `travel` | m | output: travel of the prescribed motion since its last turn, integrated over the steps |
| `start_position`, `start_velocity` | m, m/s | parameters; both motions start there, after a return stroke |
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from hashlib import sha256
from importlib.metadata import version
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from numpy.typing import ArrayLike

from compact.files import write_bytes
from compact.interfaces.force_tables import CartModel
from compact.machine.elastic_motion import share_table
from compact.machine.rigid_drive import SLOW_SPEED_RATIO
from compact.resistance import ResistanceMap
from compact.turning import StrokeResistance, table_share

MODEL = "cart"
SOURCE, DATA = "cart_fmu.c", "cart_data.h"
COMPILERS = ("cc", "gcc", "clang")  # searched for where the variable CC is not set
COMPILE_SECONDS = 120  # [s], limit
LIBRARIES = {"linux": ("linux64", ".so"), "darwin": ("darwin64", ".dylib"), "win32": ("win64", ".dll")}
SHARE_TOLERANCE = 1e-10  # [-], of the shares after a turn
DRY_RANGE = (1e-9, 1e9)  # [m/s], speeds of dry friction


class Variable(NamedTuple):
    """Variable of the unit, in the order of the value references of the sources."""

    name: str
    unit: str
    causality: str
    description: str


VARIABLES = (
    Variable("velocity", "m/s", "input", "prescribed velocity"),
    Variable("acceleration", "m/s2", "input", "prescribed acceleration"),
    Variable("applied_force", "N", "input", "force of a drive on the free cart"),
    Variable("start_position", "m", "parameter", "initial position of the free cart"),
    Variable("start_velocity", "m/s", "parameter", "initial velocity of the free cart"),
    Variable("resistance", "N", "output", "resistance of the mix at the prescribed motion"),
    Variable("guide_friction", "N", "output", "friction of the guide wheels at the prescribed motion"),
    Variable("drive_force", "N", "output", "force of a drive that prescribes the motion"),
    Variable("cart_position", "m", "output", "position of the free cart"),
    Variable("cart_velocity", "m/s", "output", "velocity of the free cart"),
    Variable("cart_acceleration", "m/s2", "output", "acceleration of the free cart"),
    Variable("travel", "m", "output", "travel of the prescribed motion since its last turn"),
)
UNITS = {"m": {"m": 1}, "m/s": {"m": 1, "s": -1}, "m/s2": {"m": 1, "s": -2}, "N": {"kg": 1, "m": 1, "s": -2}}
START = ' start="0"'  # value of an input or a parameter


def write_fmu(model: CartModel, path: Path | str, title: str = "") -> Path:
    """Write the unit of a cart.

    Parameters
    ----------
    title : str
        Description of the unit.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    RuntimeError
        If the compiler fails.
    """
    source = (files("compact") / "data" / SOURCE).read_text("utf-8")
    numbers = "\n".join(_definitions(model))
    guid = sha256((source + numbers).encode()).hexdigest()[:32]
    header = f'#define GUID "{guid}"\n{numbers}\n'
    with BytesIO() as buffer:
        with ZipFile(buffer, "w", ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", _description(guid, title))
            archive.writestr(f"sources/{SOURCE}", source)
            archive.writestr(f"sources/{DATA}", header)
            if binary := _compiled(source, header):
                folder, suffix = LIBRARIES[sys.platform]
                archive.writestr(f"binaries/{folder}/{MODEL}{suffix}", binary)
        return write_bytes(Path(path), buffer.getvalue())


def has_binary(path: Path | str) -> bool:
    """Return True if a unit contains a binary."""
    with ZipFile(path) as archive:
        return any(name.startswith("binaries/") for name in archive.namelist())


def _definitions(model: CartModel) -> Iterator[str]:
    """Yield the numbers of the sources as lines of C."""
    cart, resistance = model.cart, model.resistance
    yield from _shares(model)
    if isinstance(resistance, StrokeResistance):
        resistance = resistance.resistance
    if isinstance(resistance, ResistanceMap):
        splines, columns = resistance.splines, resistance.splines.c
        breaks, force = splines.x, columns[:, :, 0].T
        mass = columns[:, :, 1].T if resistance.added_masses is not None else np.zeros_like(force)
        limit = resistance.rate_limit if resistance.relaxation_time else 0.0
        scalars = {"EXPONENT": resistance.exponent, "RETURN_RATIO": resistance.return_ratio, "RATE_LIMIT": limit}
        fastest = float(resistance.speeds[-1])
    else:
        breaks, force, mass = np.log(DRY_RANGE), np.array([[0, 0, 0, resistance.force]]), np.zeros((1, 4))
        scalars = {"EXPONENT": 0.0, "RETURN_RATIO": 1.0, "RATE_LIMIT": 0.0}
        fastest = DRY_RANGE[1]
    front, rear = cart.guide_positions
    scalars |= {
        "FASTEST": fastest, "CART_MASS": cart.mass, "WEIGHT": cart.weight, "FRONT": front, "REAR": rear,
        "LIFT": float(np.sum(cart.roller_reactions)),
        "LIFT_MOMENT": float(np.dot(cart.roller_reactions, cart.roller_positions)),
        "RETURN_LOAD_RATIO": cart.return_load_ratio, "ARM": cart.pin_height + cart.roller_radius,
        "GUIDE_FRICTION_COEFFICIENT": cart.guide_friction, "WHEEL_RADIUS": cart.guide_wheel_diameter / 2,
    }  # fmt: skip
    yield from (f"#define {name} ({value!r})" for name, value in scalars.items())
    yield f"#define PIECES {len(force)}"
    yield f"static const double BREAKS[PIECES + 1] = {_braces(breaks)};"
    yield f"static const double FORCE[PIECES][4] = {_braces(force)};"
    yield f"static const double MASS[PIECES][4] = {_braces(mass)};"


def _shares(model: CartModel) -> Iterator[str]:
    """Yield the shares after a turn, forward and backward, as lines of C; a table without rows for a step."""
    strokes, one = model.resistance, table_share((0.0,), (1.0,))
    turns = isinstance(strokes, StrokeResistance)
    if not isinstance(strokes, StrokeResistance):
        strokes = StrokeResistance(strokes, one, one, one, one)
    pairs = (strokes.forward, strokes.forward_load), (strokes.backward, strokes.backward_load)
    tables = [share_table(share, SHARE_TOLERANCE) for pair in pairs for share in pair]
    rows = [np.column_stack([each.breaks[:-1], np.diff(each.breaks), each.coefficients]) for each in tables]
    columns = max(each.shape[1] for each in rows)
    ratio = strokes.force_ratio(SLOW_SPEED_RATIO * model.mean_speed)
    yield from (f"#define {name} ({value!r})" for name, value in {
        "TURNS": int(turns), "STROKE": model.stroke, "FORCE_RATIO": ratio, "SHARE_COLUMNS": columns,
    }.items())  # fmt: skip
    firsts = np.cumsum([0, *map(len, rows)]).tolist()
    yield f"static const int FIRSTS[5] = {{{', '.join(map(str, firsts))}}};"
    padded = np.concatenate([np.pad(each, ((0, 0), (0, columns - each.shape[1]))) for each in rows])
    yield f"static const double SHARES[{len(padded)}][{columns}] = {_braces(padded)};"
    for name, field in (("DISTANCES", "distance"), ("RELEASES", "release")):
        yield f"static const double {name}[2] = {_braces([getattr(force, field) for force, _ in pairs])};"
    yield f"static const double TRACKS[2][2] = {_braces([[each.track for each in pair] for pair in pairs])};"


def _braces(values: ArrayLike) -> str:
    """Return an array as an initialiser of C, exact to the last bit."""
    array = np.asarray(values, float)
    entries = map(_braces, array) if array.ndim > 1 else map(repr, array.tolist())
    return "{" + ", ".join(entries) + "}"


def _description(guid: str, title: str) -> str:
    """Return modelDescription.xml."""
    units, variables, outputs = "", "", ""
    for unit, powers in UNITS.items():
        base = " ".join(f'{name}="{power}"' for name, power in powers.items())
        units += f'<Unit name="{unit}"><BaseUnit {base}/></Unit>\n'
    for number, each in enumerate(VARIABLES):
        is_output, kind = each.causality == "output", "fixed" if each.causality == "parameter" else "continuous"
        variables += (
            f'<ScalarVariable name="{each.name}" valueReference="{number}" causality="{each.causality}" '
            f'variability="{kind}" description="{each.description}"><Real unit="{each.unit}"'
            f"{'' if is_output else START}/></ScalarVariable>\n"
        )
        outputs += f'<Unknown index="{number + 1}"/>\n' * is_output
    return f"""<?xml version="1.0" encoding="utf-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{MODEL}" guid="{guid}" generationTool="compact {version("compact")}"
 description={quoteattr(title or "cart of compact")} variableNamingConvention="flat">
<CoSimulation modelIdentifier="{MODEL}" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true">
<SourceFiles><File name="{SOURCE}"/></SourceFiles></CoSimulation>
<UnitDefinitions>
{units}</UnitDefinitions>
<ModelVariables>
{variables}</ModelVariables>
<ModelStructure><Outputs>
{outputs}</Outputs><InitialUnknowns>
{outputs}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def _compiled(source: str, header: str) -> bytes | None:
    """Return the shared library for this platform; None without a compiler, or on another kind of processor."""
    named = os.environ.get("CC") or next(filter(shutil.which, COMPILERS), None)
    if named is None or sys.platform not in LIBRARIES or platform.architecture()[0] != "64bit":
        return None
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / SOURCE).write_text(source, encoding="utf-8")
        (place / DATA).write_text(header, encoding="utf-8")
        library = place / f"{MODEL}{LIBRARIES[sys.platform][1]}"
        line = [*named.split(), "-std=c99", "-O2", "-fPIC", "-shared", "-o", str(library), str(place / SOURCE), "-lm"]
        done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=COMPILE_SECONDS)
        if done.returncode:
            raise RuntimeError(f"the compiler {named} failed: {done.stderr.strip()}; set CC to another, or to nothing")
        return library.read_bytes()
