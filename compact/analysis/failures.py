"""Refusals of `compact` told from errors of libraries, and sentences for errors of arithmetic and memory.

A refusal is a sentence already. Errors of arithmetic and memory are in the words of numpy and Python: they mean that a
computation left the range of floating-point numbers, mostly because a value was given in other units. Any other error
is a defect of the program.
"""

from collections.abc import Callable
from dis import opmap
from importlib.metadata import entry_points
from pathlib import Path
from traceback import walk_tb
from typing import Any

import compact

# Parts of the messages of numpy and Python, and what each means
MEANINGS = {
    "invalid value": "an operation has no result (such as 0/0 or the square root of a negative number)",
    "by zero": "a number is divided by zero",
    "overflow": "a number exceeds the range of floating-point numbers",
    "(34": "a number exceeds the range of floating-point numbers",  # OverflowError of math: errno ERANGE
    "underflow": "a number falls below the range of floating-point numbers",
}
MAX_REASON = 400  # characters of the reason why a scene of an ensemble has no result
OTHERWISE = "an equation has no finite solution"
PACKAGE = Path(compact.__file__).parent
REMEDY = "values of the scene are too large, too small or too far apart; check their units"


def is_refusal(error: BaseException) -> bool:
    """Return True for a ValueError or RuntimeError that a `raise` of this package, or of an added engine, has raised.

    Libraries raise the same classes. In their errors the innermost frame is one of their own, or one of ours that calls
    compiled code: its last instruction is no `raise`.
    """
    if not isinstance(error, ValueError | RuntimeError) or is_numeric(error):
        return False
    if getattr(error, "is_refusal", False) or _is_ours(type(error).__module__):
        return True
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return False
    frame, instruction = trace.tb_frame, trace.tb_frame.f_code.co_code[trace.tb_lasti]
    return instruction == opmap["RAISE_VARARGS"] and _is_ours(frame.f_globals["__name__"])


def run_marked(work: Callable[[Any], Any], task: Any) -> Any:
    """Run a task in a worker process and mark its refusals, which lose their frames on the way to the caller."""
    try:
        return work(task)
    except (ValueError, RuntimeError) as error:
        error.is_refusal = is_refusal(error)  # type: ignore[union-attr]
        raise


def _is_ours(module: str) -> bool:
    """Return True for a module of this package, or of a package that adds an engine or a drive."""
    from compact.engines import ENGINES  # numpy is not loaded for a page of help
    from compact.machine.drives import DRIVES

    groups = ENGINES.group, DRIVES.group
    added = {entry.module.partition(".")[0] for group in groups for entry in entry_points(group=group)}
    return module.partition(".")[0] in {"compact", *added}


def is_numeric(error: BaseException) -> bool:
    """Return True for an error of arithmetic: a RuntimeWarning of numpy, an ArithmeticError, a singular matrix."""
    return isinstance(error, RuntimeWarning | ArithmeticError) or type(error).__name__ == "LinAlgError"


def sentence_of(error: BaseException) -> str:
    """Describe an error: a refusal in its own words, else cause, innermost module of this package, and remedy."""
    said, files = str(error), [Path(frame.f_code.co_filename) for frame, _ in walk_tb(error.__traceback__)]
    modules = [file.stem for file in files if PACKAGE in file.parents]
    place = f" in {modules[-1]}" if modules else ""
    if isinstance(error, MemoryError):
        return f"not enough memory{place}; lower the number of values, speeds or passes, or loosen the tolerance"
    if is_numeric(error):
        meaning = next((words for start, words in MEANINGS.items() if start in said), OTHERWISE)
        return f"the computation failed{place}: {meaning}; {REMEDY}"
    return said if is_refusal(error) else f"internal error, please report it: {type(error).__name__}: {said}"


def reason_of(error: BaseException) -> str:
    """Describe an error in one line of at most MAX_REASON characters."""
    return ("; ".join(getattr(error, "mistakes", ())) or sentence_of(error))[:MAX_REASON]
