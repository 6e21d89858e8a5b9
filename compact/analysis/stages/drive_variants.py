"""Drives that a scene may have as well, where its drive data are not measured.

    elastic      stiffness times and over 3 at the same damping ratio; damping ratio .02 and .2
    hydraulic    bulk modulus of the oil times and over 3, in strokes with compressible oil
    motor        inertia of rotor and flywheel times and over 1.5

The factors are judgements: a spring between cam and cart is rarely known within a factor of three before it has been
loaded, and its damping within one of three before it has been struck. A key whose comment in the scene says `measured`
does not vary.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from compact.scene.loader import Scene

FACTOR = 3.0  # [-], of stiffness and bulk modulus, in either direction
INERTIA_FACTOR = 1.5  # [-], of the inertia at the shaft, in either direction
DAMPING_RATIOS = (0.02, 0.2)  # [-], of a cart on a spring
STROKE_TOLERANCE = 1e-6  # [-], relative; strokes with compressible oil


def drive_variants(scene: Scene) -> dict[str, Scene]:
    """Return the scenes with another drive, by words for the change.

    Parameters
    ----------
    scene : Scene
        Scene whose remarks state which data of the drive are measured.

    Returns
    -------
    dict of str to Scene
        Empty for a rigid drive and a crank, and where all data are measured.
    """
    changes = {"elastic": _springs, "hydraulic": _oils, "motor": _inertias}.get(scene.drive.kind)
    return {words: scene.replaced(**keys) for words, keys in (changes(scene) if changes else ())}


def _springs(scene: Scene) -> Iterator[tuple[str, dict[str, float]]]:
    stiffness, damping, mass = scene.drive.stiffness, scene.drive.damping, scene.machine.mass
    assert stiffness is not None  # rule of the scene
    assert damping is not None
    damped = scene.is_marked("drive.damping", "measured")
    for words, factor in _both("stiffness", FACTOR) if not scene.is_marked("drive.stiffness", "measured") else ():
        kept = damping if damped else damping * math.sqrt(factor)
        yield words, {"drive.stiffness": factor * stiffness, "drive.damping": kept}
    for ratio in () if damped else DAMPING_RATIOS:
        yield f"damping ratio {ratio:g}", {"drive.damping": 2 * ratio * math.sqrt(stiffness * mass)}


def _oils(scene: Scene) -> Iterator[tuple[str, dict[str, float]]]:
    key, table = "drive.hydraulics.bulk_modulus", scene.drive.hydraulics
    assert table is not None  # rule of the scene
    for words, factor in _both("bulk modulus", FACTOR) if not scene.is_marked(key, "measured") else ():
        yield words, {key: factor * table.bulk_modulus}


def _inertias(scene: Scene) -> Iterator[tuple[str, dict[str, float]]]:
    motor = scene.drive.motor
    assert motor is not None  # rule of the scene
    inertias = {"drive.motor.inertia": motor.inertia, "drive.motor.flywheel_inertia": motor.flywheel_inertia}
    unknown = {key: value for key, value in inertias.items() if value and not scene.is_marked(key, "measured")}
    for words, factor in _both("inertia", INERTIA_FACTOR) if unknown else ():
        yield words, {key: factor * value for key, value in unknown.items()}


def _both(name: str, factor: float) -> tuple[tuple[str, float], ...]:
    return (f"{name} ÷ {factor:g}", 1 / factor), (f"{name} × {factor:g}", factor)


def peaks_with_oil(run: Any, bulk_modulus: float) -> Mapping[str, float]:
    """Return the peaks of a forward stroke with compressible oil under the valve areas of a run.

    Parameters
    ----------
    run : HydraulicRun
        Run whose valve areas realise the law with an incompressible oil.
    bulk_modulus : float
        Bulk modulus of the oil [Pa].

    Returns
    -------
    mapping of str to float
        `peak_force` [N] and `peak_power` [W].
    """
    oil = replace(run, hydraulic=replace(run.hydraulic, bulk_modulus=bulk_modulus))
    stroke = oil.simulate_stroke(rtol=STROKE_TOLERANCE)
    force = run.hydraulic.piston_area * (stroke.inlet_pressure - stroke.outlet_pressure)
    return {"peak_force": float(np.abs(force).max()), "peak_power": float(np.abs(force * stroke.velocity).max())}
