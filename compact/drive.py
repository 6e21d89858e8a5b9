"""Drives of a cart: one cycle of a motion law under a drive, and the ranking of laws by the demand on the drive.

    run = simulate(cart, Rigid(), law("cubic", 0.4, 1.0).cycle(), resistance)

A rigid drive and a crank impose the law (`machine.rigid_drive`). `ElasticDrive`, `Motor` and `Hydraulic` solve for a
periodic cycle; their modules in `machine` are imported on first use.
"""

from typing import Any

from compact.machine.ranking import CRITERIA, Ranked, rank
from compact.machine.rigid_drive import Crank, Rigid, Run, simulate

_ELASTIC = ("ElasticDrive", "ElasticRun")
_MOTOR = ("Motor", "MotorRun")
_HYDRAULIC = ("Hydraulic", "HydraulicRun")

__all__ = ["CRITERIA", "Crank", "Ranked", "Rigid", "Run", "rank", "simulate", *_ELASTIC, *_MOTOR, *_HYDRAULIC]


def __getattr__(name: str) -> Any:
    if name in _ELASTIC:
        from compact.machine import elastic_drive

        return getattr(elastic_drive, name)
    if name in _MOTOR:
        from compact.machine import motor_drive

        return getattr(motor_drive, name)
    if name in _HYDRAULIC:
        from compact.machine import hydraulic_drive

        return getattr(hydraulic_drive, name)
    raise AttributeError(f"module 'compact.drive' has no attribute {name!r}")
