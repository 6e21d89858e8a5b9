"""Motion laws of the cart: published laws, laws from tables, and optimal laws for a machine."""

from importlib import import_module
from typing import Any

_NAMES_OF = {  # public names by module
    "laws": ("LAWS", "ComplexLaw", "minimiser"),
    "limits": ("CamLimits", "InfeasibleError", "Limits"),
    "optimal_motion": ("OptimalMotion", "optimise"),
    "profile": ("Cycle", "MotionProfile", "law"),
    "tabulated": ("from_function", "from_table"),
}
__all__ = [name for names in _NAMES_OF.values() for name in names]


def __getattr__(name: str) -> Any:
    home = next((module for module, names in _NAMES_OF.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module 'compact.motion' has no attribute {name!r}")
    return getattr(import_module(f"compact.motion.{home}"), name)
