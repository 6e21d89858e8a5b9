"""Compiled functions whose cache on disk follows the source files that they call.

numba keeps a compiled function until its own file changes. The machine code contains the functions and constants of
other modules, so a change there would go unnoticed. `compiled` stamps the cache with every source file of the same
package that the module of the function imports, directly or through other modules. A damaged cache file is written
again; where no file can be written, functions are compiled in every process.

Processes that need the same function at the same time compile it once: one of them compiles, the others wait for its
file. Compilation is a third of the processor time of a first run.
"""

import ast
import logging
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from filelock import FileLock
from numba import njit
from numba.core.caching import IndexDataCacheFile

LOCK_TIMEOUT = 300.0  # [s], that one process compiles a function; then another process compiles it too

_LOG = logging.getLogger(__name__)
_threads = threading.RLock()  # of this process; taken before the lock of a file, so that no two threads wait in turn


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of numbers and arrays by numba; division by zero gives inf or nan as in numpy.

    The compiled function is cached on disk until a source file that it depends on changes. Threads run it at a time.
    """
    # an entry from C has no caller
    options: dict[str, Any] = {"no_cfunc_wrapper": True, "error_model": "numpy", "nogil": True}
    try:
        dispatcher: Any = njit(cache=True, **options)(function)
    except RuntimeError:  # of numba: neither the package, nor the home, nor NUMBA_CACHE_DIR can be written
        if parent_process() is None:
            _tell("no folder for compiled code can be written: each run compiles; NUMBA_CACHE_DIR may name one")
        return njit(**options)(function)
    files: Any = getattr(dispatcher, "_cache", None)
    if getattr(files, "_cache_file", None):  # absent where numba does not cache
        sources = sorted(source_files(function.__module__))
        stamp = tuple(sha256(Path(path).read_bytes()).hexdigest() for path in sources)
        files._cache_file = _KeptFile(files._cache_path, files._impl.filename_base, stamp)
        path = Path(files._cache_file._index_path).with_suffix(".lock")
        dispatcher.compile = _once(dispatcher.compile, path, lambda: is_compiled(dispatcher))
    return dispatcher


#: Make a function part of the `compiled` functions that call it, which saves its own compilation; for long functions
#: with one caller.
inlined: Any = njit(error_model="numpy", inline="always")
#: Compile a function that only `compiled` functions call, without an entry from Python and a cache of its own: both
#: take a third of the time of its compilation, and the cached code of its callers contains it.
NO_ENTRIES: dict[str, Any] = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}
internal: Any = njit(error_model="numpy", **NO_ENTRIES)


def is_compiled(function: Any) -> bool:
    """Return True if a `compiled` function needs no compilation: used before, or cached on disk and up to date."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return bool(function.signatures) or (file is not None and bool(file._load_index()))


def _once(compile_types: Callable[[Any], Any], path: Path, known: Callable[[], bool]) -> Callable[[Any], Any]:
    """Let one process at a time compile or load a function.

    Functions that it calls are compiled inside; a callee never waits for its caller, so that no two processes wait in
    turn. Without a lock where the folder or its disk allows none.
    """
    locks: dict[int, FileLock] = {}  # by process; a forked one must not use that of its parent

    def compile_once(types: Any) -> Any:
        with _threads:
            lock = locks.get(os.getpid()) or locks.setdefault(os.getpid(), FileLock(path, timeout=LOCK_TIMEOUT))
            with suppress(OSError, NotImplementedError):  # a timeout is an OSError
                path.parent.mkdir(parents=True, exist_ok=True)
                lock.acquire()
            try:
                if not known():
                    _LOG.info("compiling %s, once on this machine", path.name.partition("-")[0])
                return compile_types(types)
            finally:
                lock.release()

    return compile_once


class _KeptFile(IndexDataCacheFile):
    """Cache file of numba; one that is damaged, of another version, or cannot be written counts as absent."""

    def _load_index(self) -> dict[Any, Any]:
        try:
            return super()._load_index()
        except Exception:
            _tell("compiled code on disk is damaged, or of another version; it is compiled again")
            return {}

    def _load_data(self, name: str) -> Any:
        try:
            return super()._load_data(name)
        except Exception as error:
            _tell("compiled code on disk is damaged, or of another version; it is compiled again")
            raise OSError(name) from error  # numba compiles

    def save(self, key: Any, data: Any) -> None:
        try:
            super().save(key, data)
        except OSError as error:
            _tell(f"compiled code cannot be kept: {error.strerror or error}; the next run compiles again")


@cache
def _tell(sentence: str) -> None:
    """Log a sentence on the cache, once in a process."""
    _LOG.warning(sentence)


@cache
def source_files(module: str) -> frozenset[str]:
    """Source files of a module and of the modules of its package that it imports, directly or through others.

    A module outside a package depends on modules in its own directory.
    """
    home, package = Path(getattr(sys.modules[module], "__file__", None) or "."), module.partition(".")[0]
    found: dict[str, str] = {}
    pending = [module]
    while pending:
        name = pending.pop()
        file = getattr(sys.modules.get(name), "__file__", None)
        beside = "." not in module and file is not None and Path(file).parent == home.parent
        if file is None or name in found or not (beside or name.partition(".")[0] == package):
            continue
        found[name] = file
        for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                pending += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                pending += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return frozenset(found.values())
