"""Compiled functions whose cache on disk follows the source files that they call.

numba keeps a compiled function until its own file changes. The machine code contains the functions and constants of
other modules, so a change there would go unnoticed. `compiled` stamps the cache with every source file of the same
package that the module of the function imports, directly or through other modules. A cache file without its checksum is
written again; where no file can be written, functions are compiled in every process.

Processes that need the same function at the same time compile it once: one of them compiles, the others wait for its
file. Compilation is a third of the processor time of a first run.
"""

import ast
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from io import BytesIO
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from filelock import FileLock
from numba import njit

LOCK_TIMEOUT = 300.0  # [s], that one process compiles a function; then another process compiles it too
DIGEST_SIZE = sha256().digest_size  # [byte], of the checksum at the end of a cache file

_LOG = logging.getLogger(__name__)


def compiled(function: Callable[..., Any], nogil: bool = False) -> Callable[..., Any]:
    """Compile a function of numbers and arrays by numba; division by zero gives inf or nan as in numpy.

    The compiled function is cached on disk until a source file that it depends on changes. With `nogil`, threads may
    call it at the same time.
    """
    options: dict[str, Any] = {"no_cfunc_wrapper": True}  # an entry from C, which nothing calls
    options |= {"error_model": "numpy", "nogil": nogil}
    try:
        dispatcher: Any = njit(cache=True, **options)(function)
    except RuntimeError:  # of numba: neither the package, nor the home, nor NUMBA_CACHE_DIR can be written
        if parent_process() is None:
            _tell("no folder for compiled code can be written: each run compiles; NUMBA_CACHE_DIR may name one")
        return njit(**options)(function)
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)  # absent where numba does not cache
    if file:
        file._source_stamp = tuple(
            sha256(Path(path).read_bytes()).hexdigest() for path in sorted(source_files(function.__module__))
        )
        _add_checksums(file)
        dispatcher.compile = _once(dispatcher.compile, Path(file._index_path).with_suffix(".lock"))
    return dispatcher


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function part of the `compiled` functions that call it, which saves its own compilation.

    Suits long functions with one caller.
    """
    made: Callable[..., Any] = njit(error_model="numpy", inline="always")(function)
    return made


def internal(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that only `compiled` functions call, without an entry from Python and a cache of its own.

    Both take a third of the time of its compilation; the cached code of its callers contains it.
    """
    options: dict[str, Any] = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}
    made: Callable[..., Any] = njit(error_model="numpy", **options)(function)
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
    """Hold the lock of a file, which ends with the process; without one where the folder or its disk allows none."""
    lock = FileLock(path, timeout=LOCK_TIMEOUT)
    with suppress(OSError, NotImplementedError):  # a timeout is an OSError
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def is_compiled(function: Any) -> bool:
    """Return True if a `compiled` function needs no compilation: used before, or cached on disk and up to date."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return bool(function.signatures) or (file is not None and bool(file._load_index()))


def _add_checksums(file: Any) -> None:
    """Let a cache file of numba end with a checksum; one that is damaged or cannot be written counts as absent."""
    open_for_write, load_index, load_data, save = file._open_for_write, file._load_index, file._load_data, file.save

    @contextmanager
    def open_with_checksum(path: str) -> Iterator[BytesIO]:
        content = BytesIO()
        with open_for_write(path) as stream:
            yield content
            stream.write(content.getvalue() + sha256(content.getvalue()).digest())

    def load_sound_index() -> dict[Any, Any]:
        try:
            return load_index() if _is_sound(file._index_path) else {}
        except (AttributeError, ImportError):  # pickled argument types of another version of the package
            return {}

    def load_sound_data(name: str) -> Any:
        if not _is_sound(file._data_path(name)):
            raise FileNotFoundError(name)  # numba compiles
        return load_data(name)

    def save_if_possible(key: Any, data: Any) -> None:
        try:
            save(key, data)
        except OSError as error:
            _tell(f"compiled code cannot be kept: {error.strerror or error}; the next run compiles again")

    file._open_for_write, file._load_index = open_with_checksum, load_sound_index
    file._load_data, file.save = load_sound_data, save_if_possible


def _is_sound(path: str) -> bool:
    """Return True for a cache file that ends with its checksum; False for a missing or damaged one."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    sound = sha256(content[:-DIGEST_SIZE]).digest() == content[-DIGEST_SIZE:]
    if not sound:
        _tell("compiled code on disk is damaged, or of another version; it is compiled again")
    return sound


@cache
def _tell(sentence: str) -> None:
    """Log a sentence on the cache, once in a process."""
    _LOG.warning(sentence)


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
