"""Motion laws of the cart: published laws, laws from tables, and optimal laws for a machine."""

from importlib import import_module
from typing import Any

_HOME_OF = {
    "LAWS": "laws",
    "CamLimits": "limits",
    "ComplexLaw": "minimum_criterion",
    "Cycle": "profile",
    "InfeasibleError": "limits",
    "Limits": "limits",
    "MotionProfile": "profile",
    "OptimalMotion": "optimal_motion",
    "from_function": "tabulated",
    "from_table": "tabulated",
    "law": "profile",
    "minimiser": "minimum_criterion",
    "optimise": "optimal_motion",
}
__all__ = [*_HOME_OF]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'compact.motion' has no attribute {name!r}")
    return getattr(import_module(f"compact.motion.{_HOME_OF[name]}"), name)
