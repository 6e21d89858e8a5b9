"""Motion laws of the cart: published laws, laws from tables, and optimal laws for a machine."""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module 'compact.motion' has no attribute {name!r}")
    return getattr(import_module("compact"), name)  # loaded when first used
