"""Compiled functions whose cache on disk follows the source files that they call.

numba keeps a compiled function until its own file changes. The machine code contains the functions and constants of
other modules, so a change there would go unnoticed. `compiled` stamps the cache with every source file of the same
package that the module of the function imports, directly or through other modules.

Processes that need the same function at the same time compile it once: one of them compiles, the others wait for its
file. Compilation is a third of the processor time of a first run.
"""

import ast
import fcntl
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any], nogil: bool = False) -> Callable[..., Any]:
    """Compile a function of numbers and arrays by numba; division by zero gives inf or nan as in numpy.

    The compiled function is cached on disk until a source file that it depends on changes. With `nogil`, threads may
    call it at the same time.
    """
    options: dict[str, Any] = {"no_cfunc_wrapper": True}  # an entry from C, which nothing calls
    dispatcher: Any = njit(error_model="numpy", cache=True, nogil=nogil, **options)(function)
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)  # absent where numba does not cache
    if file:
        file._source_stamp = tuple(
            (stat.st_mtime, stat.st_size) for stat in map(os.stat, sorted(source_files(function.__module__)))
        )
        file._load_index = _readable(file._load_index)
        dispatcher.compile = _once(dispatcher.compile, Path(file._index_path).with_suffix(".lock"))
    return dispatcher


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function part of the `compiled` functions that call it, which saves its own compilation.

    Suits long functions with one caller.
    """
    made: Callable[..., Any] = njit(error_model="numpy", inline="always")(function)
    return made


class _Compilation(threading.local):
    """Number of nested compilations of a thread."""

    depth = 0


_compilation = _Compilation()
_threads = threading.RLock()  # of this process; taken before the lock of a file, so that no two threads wait in turn


def _once(compile_types: Callable[[Any], Any], path: Path) -> Callable[[Any], Any]:
    """Let one process at a time compile or load a function; functions that it calls are compiled with it."""

    def compile_once(types: Any) -> Any:
        with _threads:
            _compilation.depth += 1
            try:
                if _compilation.depth > 1:
                    return compile_types(types)
                with _locked(path):
                    return compile_types(types)
            finally:
                _compilation.depth -= 1

    return compile_once


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file, which ends with the process; without one where the folder allows none."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
    try:
        file = path.open("a")
    except OSError:
        yield
        return
    with file:
        with suppress(OSError):  # network file systems may have no locks
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def is_compiled(function: Any) -> bool:
    """Return True if a `compiled` function needs no compilation: used before, or cached on disk and up to date."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return bool(function.signatures) or (file is not None and bool(file._load_index()))


def _readable(load_index: Callable[[], dict[Any, Any]]) -> Callable[[], dict[Any, Any]]:
    """Wrap the reader of a cache index, so that an index which names a class that is gone counts as empty."""

    def load() -> dict[Any, Any]:
        try:
            return load_index()
        except (AttributeError, ImportError):  # pickled argument types of another version of the package
            return {}

    return load


@cache
def source_files(module: str) -> frozenset[str]:
    """Source files of a module and of the modules of its package that it imports, directly or through others.

    A module outside a package depends on modules in its own directory.
    """
    found: dict[str, str] = {}
    pending = [module]
    while pending:
        name = pending.pop()
        file = getattr(sys.modules.get(name), "__file__", None)
        if file and name not in found and _is_related(name, file, module):
            found[name] = file
            pending += _imported_names(Path(file))
    return frozenset(found.values())


def _is_related(name: str, file: str, module: str) -> bool:
    """Return True for a module of the same package, or in the same directory as a module without a package."""
    package = module.partition(".")[0]
    if name.partition(".")[0] == package:
        return True
    home = getattr(sys.modules[module], "__file__", None)
    return "." not in module and home is not None and Path(file).parent == Path(home).parent


def _imported_names(file: Path) -> Iterator[str]:
    """Yield the full names of all modules that a source file may import."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
