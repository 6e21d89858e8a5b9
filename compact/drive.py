"""Drives of a cart: one cycle of a motion law under a drive, and the ranking of laws by the demand on the drive.

    run = simulate(cart, Rigid(), law("cubic", 0.4, 1.0).cycle(), resistance)

A rigid drive and a crank impose the law (`machine.rigid_drive`). `ElasticDrive`, `Motor` and `Hydraulic` solve for a
periodic cycle; their modules in `machine` are imported on first use.
"""

from importlib import import_module
from typing import Any

from compact.machine.ranking import CRITERIA, Ranked, rank
from compact.machine.rigid_drive import Crank, Rigid, Run, simulate

_HOMES = {  # modules of the drives that solve for a cycle
    "ElasticDrive": "elastic_drive", "ElasticRun": "elastic_drive", "Motor": "motor_drive", "MotorRun": "motor_drive",
    "Hydraulic": "hydraulic_drive", "HydraulicRun": "hydraulic_drive",
}  # fmt: skip
__all__ = ["CRITERIA", "Crank", "Ranked", "Rigid", "Run", "rank", "simulate", *_HOMES]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"compact.machine.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'compact.drive' has no attribute {name!r}")
