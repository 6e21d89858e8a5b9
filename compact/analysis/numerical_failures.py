"""Sentences for errors of arithmetic and memory, which numpy and Python raise in their own words.

The refusals of `compact` are sentences already. These errors are not: they mean that a computation left the range of
floating-point numbers, mostly because a value was given in other units.
"""

from pathlib import Path
from traceback import walk_tb

import compact

# Beginnings of the messages of numpy and Python, and what each means
MEANINGS = {
    "invalid value": "an operation has no result (such as 0/0 or the square root of a negative number)",
    "divide by zero": "a number is divided by zero",
    "division by zero": "a number is divided by zero",
    "float division by zero": "a number is divided by zero",
    "overflow": "a number exceeds the range of floating-point numbers",
    "(34": "a number exceeds the range of floating-point numbers",  # OverflowError of math: errno ERANGE
    "underflow": "a number falls below the range of floating-point numbers",
}
OTHERWISE = "an equation has no finite solution"
PACKAGE = Path(compact.__file__).parent
REMEDY = "values of the scene are too large, too small or too far apart; check their units"


def is_numeric(error: BaseException) -> bool:
    """Return True for an error of arithmetic: a RuntimeWarning of numpy, an ArithmeticError, a singular matrix."""
    return isinstance(error, RuntimeWarning | ArithmeticError) or type(error).__name__ == "LinAlgError"


def numeric_sentence(error: BaseException) -> str:
    """Cause, module and remedy of an error for which `is_numeric` holds."""
    said = str(error)
    meaning = next((words for start, words in MEANINGS.items() if said.startswith(start)), OTHERWISE)
    return f"the computation failed{_place(error)}: {meaning}; {REMEDY}"


def memory_sentence(error: MemoryError) -> str:
    """Place and remedy of an allocation that failed."""
    return f"not enough memory{_place(error)}; lower the number of values, speeds or passes, or loosen the tolerance"


def _place(error: BaseException) -> str:
    """Name the innermost module of this package in which an error was raised; empty if there is none."""
    files = [Path(frame.f_code.co_filename) for frame, _ in walk_tb(error.__traceback__)]
    modules = [file.stem for file in files if PACKAGE in file.parents]
    return f" in {modules[-1]}" if modules else ""
