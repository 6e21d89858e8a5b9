"""Motion laws of the cart: published laws, tables, and laws optimal for a machine."""

from importlib import import_module
from typing import Any

_HOME_OF = {
    "LAWS": "profile",
    "CamLimits": "profile",
    "Cycle": "profile",
    "InfeasibleError": "profile",
    "Limits": "profile",
    "Motion": "profile",
    "OptimalMotion": "profile",
    "law": "profile",
    "optimise": "profile",
    "from_table": "tabulated",
    "ComplexLaw": "minimum_criterion",
    "minimiser": "minimum_criterion",
}
__all__ = [*_HOME_OF]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'compact.motion' has no attribute {name!r}")
    return getattr(import_module(f"compact.motion.{_HOME_OF[name]}"), name)
