"""Cache of compiled functions: it follows changes of functions and constants in other modules."""

import errno
import importlib
import sys
import threading
from pathlib import Path

import numba
import pytest
from filelock import FileLock
from numba.core import caching

from compact.numerics import jit
from compact.numerics.jit import source_files

CALLER = """\
from compact.numerics.jit import compiled
{imports}
@compiled
def result():
    return 10 * {package}middle.value()
"""
MIDDLE = """\
from compact.numerics.jit import compiled
import {package}constants
from {package}callee import step
OFFSET = 5
@compiled
def value():
    return step() + {package}constants.SCALE + OFFSET
"""
CALLEE = "from compact.numerics.jit import compiled\n@compiled\ndef step():\n    return 1\n"
CONSTANTS = "SCALE = 100\n"
CHANGES = {
    "constant of the called module": ("middle.py", "OFFSET = 5", "OFFSET = 6", 1070),
    "constant two modules away": ("constants.py", "SCALE = 100", "SCALE = 200", 2060),
    "function two modules away": ("callee.py", "return 1", "return 22", 1270),
}


def imported(module):
    """Compiled function of a module, imported as by a new process."""
    source_files.cache_clear()
    for name in ["caller", "middle", "callee", "constants", "jit_sample"]:
        for loaded in [loaded for loaded in sys.modules if loaded.split(".")[0] == name]:
            del sys.modules[loaded]
    importlib.invalidate_caches()
    return importlib.import_module(module).result


def compiled_result(module):
    """Result, and number of cache hits, of a function imported as by a new process."""
    function = imported(module)
    return function(), sum(function.stats.cache_hits.values())


@pytest.fixture
def sample(request, tmp_path, monkeypatch):
    """Folder and name of a module whose compiled function calls others."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")  # the cache stands beside the module, whatever NUMBA_CACHE_DIR
    package = getattr(request, "param", "jit_sample.")
    folder = tmp_path / package.rstrip(".")
    folder.mkdir(exist_ok=True)
    if package:
        (folder / "__init__.py").touch()
    (folder / "caller.py").write_text(CALLER.format(package=package, imports=f"import {package}middle"))
    (folder / "middle.py").write_text(MIDDLE.format(package=package))
    (folder / "callee.py").write_text(CALLEE)
    (folder / "constants.py").write_text(CONSTANTS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # changes within one second must be read
    return folder, f"{package}caller"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("sample", ["", "jit_sample."], ids=["modules", "package"], indirect=True)
@pytest.mark.parametrize("change", CHANGES)
def test_a_change_in_another_module_recompiles_the_caller(sample, change):
    folder, module = sample
    assert compiled_result(module) == (1060, 0)
    assert compiled_result(module) == (1060, 1)
    file, old, new, expected = CHANGES[change]
    path = folder / file
    path.write_text(path.read_text().replace(old, new))
    assert compiled_result(module) == (expected, 0)


# cache that cannot be written, or is damaged


@pytest.fixture
def told(caplog):
    """Sentences on the cache."""
    jit._tell.cache_clear()
    return lambda: [each for each in caplog.messages if not each.startswith("compiling")]


DAMAGES = {"empty": lambda content: b"", "truncated": lambda content: content[:-40]}


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_cache_is_compiled_again(sample, told, suffix, damage):
    folder, module = sample
    assert compiled_result(module) == (1060, 0)
    (damaged,) = (folder / "__pycache__").glob(f"caller*.{suffix}")
    damaged.write_bytes(DAMAGES[damage](damaged.read_bytes()))
    assert compiled_result(module) == (1060, 0)
    assert told() == ["compiled code on disk is damaged, or of another version; it is compiled again"]
    assert compiled_result(module) == (1060, 1)


# without the locks of Unix


def test_a_process_waits_while_another_one_compiles(sample):
    _, module = sample
    function, found = imported(module), []
    lock = Path(function._cache._cache_file._index_path).with_suffix(".lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    thread = threading.Thread(target=lambda: found.append(function()), daemon=True)
    with FileLock(lock):
        thread.start()
        thread.join(0.2)
        assert thread.is_alive()
    thread.join()
    assert found == [1060]


def test_function_is_compiled_where_no_folder_can_be_written(sample, told, monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert imported(sample[1])() == 1060
    assert told() == ["no folder for compiled code can be written: each run compiles; NUMBA_CACHE_DIR may name one"]


def test_function_is_compiled_though_the_disk_is_full(sample, told, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "_save_index", full)
    assert compiled_result(sample[1]) == (1060, 0)
    assert told() == ["compiled code cannot be kept: No space left on device; the next run compiles again"]
