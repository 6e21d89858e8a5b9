"""File formats and result directories.

Every file is written under a temporary name and renamed when complete, so that an interrupted run leaves no partial
file. A result directory belongs to the scene whose hash its file `scene.hash` contains; another scene is refused.

Results that a later run may use again are kept under the hash of `results_key`, and are valid with their checksum only.
"""

import csv
import json
import logging
import math
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from importlib.resources.abc import Traversable
from io import BytesIO, StringIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal
from xml.etree import ElementTree

if TYPE_CHECKING:
    import meshio
    import xarray
    from matplotlib.figure import Figure

OWNER_FILE = "scene.hash"  # file of a result directory with the hash of its scene
FIGURE_DPI = 110  # [1/inch], resolution of figures
NetcdfFormat = Literal["NETCDF3_CLASSIC", "NETCDF4"]
NETCDF_CLASSIC: NetcdfFormat = "NETCDF3_CLASSIC"  # numbers only, for any reader
NETCDF_HDF5: NetcdfFormat = "NETCDF4"  # strings too
# xarray backend of each format
NETCDF_BACKENDS: dict[str, Literal["scipy", "h5netcdf"]] = {NETCDF_CLASSIC: "scipy", NETCDF_HDF5: "h5netcdf"}
GENERIC_STEM = "scene"  # stem of the scene file that `compact new` writes into a folder of the user's name
PACKAGES = ("compact", "numpy", "scipy", "numba", "scikit-fem", "clarabel")  # on whose versions results depend
SOURCES = (".py", ".csv")  # suffixes of the files of this package on which results depend


_LOG = logging.getLogger(__name__)


class ResultsError(RuntimeError):
    """Error for a result that could not be written, or a directory with results of another scene."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of PACKAGES, and a hash of the sources of this package, by name."""
    packages, package = {name: version(name) for name in PACKAGES}, Path(__file__).parent
    sources = sorted(path.relative_to(package).as_posix() for path in package.rglob("*") if path.suffix in SOURCES)
    hashed = checksum("".join(f"{name} {checksum((package / name).read_bytes())}\n" for name in sources).encode())
    return {"python": platform.python_version()} | packages | {"source": hashed[:12]}


def results_key(*inputs: Any) -> str:
    """Hash `versions` and all inputs of a result: the key under which a later run finds the result again.

    Parameters
    ----------
    *inputs : object
        Values of JSON. A file that the scene names enters by its checksum, as its name says nothing of its content.

    Returns
    -------
    str
        SHA-256, hexadecimal.
    """
    return checksum(json.dumps([versions(), *inputs], sort_keys=True).encode())


def checksum(content: bytes) -> str:
    """Return the SHA-256 of a content, hexadecimal."""
    return sha256(content).hexdigest()


@contextmanager
def atomic_file(path: str | Path, mode: str = "w") -> Iterator[IO[Any]]:
    """Open a file that appears under its name when the block ends without an error, or not at all.

    Parameters
    ----------
    path : path
        Name of the file; a symbolic link is followed. Missing directories are created.
    mode : {"w", "wb"}
        Mode of `open`; text is UTF-8.

    Raises
    ------
    ResultsError
        If the file cannot be written.
    """
    path = Path(path).resolve()
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    encoding, newline = (None, None) if "b" in mode else ("utf-8", "")
    try:
        if path.exists() and not path.is_file():
            raise ResultsError(f"{path}: not a regular file; use another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open(mode, encoding=encoding, newline=newline) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
        _LOG.info("%s written", path)
    except OSError as error:
        raise ResultsError(f"{path}: could not be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # an invalid path has no temporary file
            temporary.unlink(missing_ok=True)


def published_scenes() -> dict[str, Path]:
    """Return the files of the scenes inside this package by name, and of the measurements that belong to them."""
    return {path.stem: path for path in sorted((Path(__file__).parent / "data" / "scenes").glob("*.toml"))}


def scene_file(path: str | Path) -> Path:
    """Return the path of a file, or of a published scene by its name where no file has it."""
    published = published_scenes().get(str(path))
    return published if published and not Path(path).exists() else Path(path)


def default_directory(scene_path: str | Path, suffix: str = "", changes: str = "") -> Path:
    """Return the default directory for the results of a scene file.

    Returns
    -------
    Path
        `out/NAME-CHANGES-SUFFIX` without empty parts. NAME is the stem of the file, or the name of its folder for a
        file `scene.toml`, so that `a/scene.toml` and `b/scene.toml` have separate results; CHANGES are the changed
        values of the scene.
    """
    path, name = Path(scene_path), Path(scene_path).stem
    if name == GENERIC_STEM:
        name = path.resolve().parent.name or name  # the root of the file system has no name
    return Path("out") / "-".join(filter(None, (name, changes, suffix)))


def read_table(path: Path | Traversable, columns: Sequence[str] = ()) -> list[tuple[int, dict[str, str]]]:
    """Read a CSV file with a header, without its blank lines and its lines that begin with "#".

    Parameters
    ----------
    path : path
        File, or resource of a package.
    columns : sequence of str
        Columns that the header must have; it may have others.

    Returns
    -------
    list of (int, dict of str to str)
        Number of the line, and its cells by the name of their column, without blanks around them.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column or repeats one, or a row has too many or too few cells; the message
        states the file, and the line of a row.
    """
    try:
        reader = csv.reader(StringIO(path.read_text(encoding="utf-8"), newline=""), skipinitialspace=True)
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    lines = [(line, cells) for line, cells in lines if any(cells) and not cells[0].startswith("#")]
    header, *rows = lines or [(1, [])]
    if missing := [name for name in columns if name not in header[1]]:
        raise ValueError(f"{path}:{header[0]}: lacks the columns {', '.join(missing)}")
    if len(set(header[1])) < len(header[1]):
        raise ValueError(f"{path}:{header[0]}: each column must have a name of its own, got {', '.join(header[1])}")
    for line, cells in rows:
        if len(cells) != len(header[1]):
            raise ValueError(f"{path}:{line}: must have a cell for each of {len(header[1])} columns, got {len(cells)}")
    return [(line, dict(zip(header[1], cells, strict=True))) for line, cells in rows]


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Iterable[Any]]) -> Path:
    """Write rows of numbers, with 12 digits, and words."""
    with atomic_file(path) as stream:
        writer, numbers = csv.writer(stream, lineterminator="\n"), ",".join(["%.12g"] * len(header)) + "\n"
        writer.writerow(header)
        for row in rows:
            if all(type(value) is float for value in row):
                stream.write(numbers % tuple(row))
            else:
                writer.writerow([f"{value:.12g}" if isinstance(value, float) else value for value in row])
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write JSON, with infinity as "infinite" and nan as null; return the path."""
    return write_text(path, json_text(content) + "\n")


def read_json(path: Path) -> Any:
    """Read a file of `write_json`; infinity is "infinite" and nan is None."""
    return json.loads(path.read_text(encoding="utf-8"))


def json_text(content: Mapping[str, Any]) -> str:
    """Return JSON, with infinity as "infinite" and nan as null."""
    return json.dumps(_json_value(content), indent=2, allow_nan=False)


def _json_value(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return _json_value(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "infinite" if value > 0 else "-infinite"
    return value


def write_bytes(path: Path, content: bytes) -> Path:
    """Write bytes; return the path."""
    with atomic_file(path, "wb") as stream:
        stream.write(content)
    return path


def write_text(path: Path, text: str) -> Path:
    """Write a text in UTF-8; return the path."""
    return write_bytes(path, text.encode())


def write_checked(path: Path, content: Any) -> Path:
    """Write JSON after its checksum, by which `read_checked` finds a damaged file; return the path."""
    return write_text(path, json.dumps([checksum(json.dumps(content).encode()), content]))


def read_checked(path: Path) -> Any:
    """Read a file of `write_checked`; ValueError or TypeError if it is damaged."""
    recorded, content = json.loads(path.read_bytes())
    if recorded != checksum(json.dumps(content).encode()):
        raise ValueError(f"{path}: damaged")
    return content


def write_netcdf(path: Path, dataset: "xarray.Dataset", kind: NetcdfFormat) -> Path:
    """Write a dataset as netCDF of a format of `NETCDF_BACKENDS`; return the path."""
    return write_bytes(path, bytes(dataset.to_netcdf(format=kind, engine=NETCDF_BACKENDS[kind])))


def read_netcdf(path: str | Path, kind: NetcdfFormat) -> "xarray.Dataset":
    """Read a netCDF file of a format of `NETCDF_BACKENDS` into memory."""
    import xarray

    return xarray.load_dataset(path, engine=NETCDF_BACKENDS[kind])


def write_figure(path: Path, figure: "Figure") -> Path:
    """Write a matplotlib figure as PNG; return the path."""
    return write_bytes(path, render_png(figure))


def render_png(figure: "Figure") -> bytes:
    """Render a matplotlib figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=max(FIGURE_DPI, figure.dpi))
    return buffer.getvalue()


def write_vtu(mesh: "meshio.Mesh", path: str | Path) -> Path:
    """Write a mesh with its fields as VTU; return the path."""
    import meshio

    with atomic_file(path, "wb") as stream:  # meshio opens the file by its name
        meshio.write(stream.name, mesh, file_format="vtu")
    return Path(path)


def write_vtu_series(
    collection: Path, folder: str, label: str, frames: Iterable[tuple[float, "meshio.Mesh"]]
) -> Iterator[Path]:
    """Write a series of fields as VTU files with a PVD collection of ParaView.

    Parameters
    ----------
    collection : Path
        PVD file, written last, so that all files it names exist.
    label : str
        Name of the series parameter; a file is called LABEL=VALUE.vtu.
    frames : iterable of (float, meshio.Mesh)
        Parameter, in the place of the time of ParaView, and fields.
    """
    series = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    members = ElementTree.SubElement(series, "Collection")
    for value, mesh in frames:
        file = f"{folder}/{label}={value!r}.vtu"
        yield write_vtu(mesh, collection.parent / file)
        ElementTree.SubElement(members, "DataSet", timestep=repr(value), part="0", file=file)
    ElementTree.indent(series)
    yield write_bytes(collection, ElementTree.tostring(series, encoding="utf-8", xml_declaration=True))


def read_vtu_series(collection: str | Path) -> tuple[str, tuple[tuple[float, "meshio.Mesh"], ...]]:
    """Read a series of fields from a PVD collection.

    Parameters
    ----------
    collection : path
        PVD file, as `write_vtu_series` writes it.

    Returns
    -------
    parameter : str
        Name of the series parameter, from the names of the files; "time" where these have none.
    frames : tuple of (float, meshio.Mesh)
        Value of the parameter and mesh of each file, in the order of the collection.

    Raises
    ------
    ValueError
        If the file is no collection of ParaView, or names a file that is missing or no mesh.
    """
    import meshio

    path, frames, parameter = Path(collection), [], "time"
    try:
        for element in ElementTree.parse(path).getroot().iter("DataSet"):
            file = element.attrib["file"]
            frames.append((float(element.attrib["timestep"]), meshio.read(path.parent / file)))
            parameter = Path(file).name.partition("=")[0] if "=" in file else parameter
    except (OSError, LookupError, ValueError, ElementTree.ParseError, SystemExit, meshio.ReadError) as error:
        raise ValueError(f"{path}: not a readable PVD collection ({error})") from None
    if not frames:
        raise ValueError(f"{path}: not a PVD collection, as it names no file")
    return parameter, tuple(frames)


@contextmanager
def claimed_directory(directory: str | Path, owner: str, force: bool = False) -> Iterator[Path]:
    """Create a result directory where necessary, and mark it with the owner of its results.

    The mark is deleted if the block fails before it writes a result.

    Parameters
    ----------
    owner : str
        Hash of a scene, and on a second line that of its file: results of the file before its edit are replaced, file
        by file, with a warning.
    force : bool
        True to overwrite results of another scene, file by file.

    Raises
    ------
    ResultsError
        If the directory contains results of another scene or other files, or another command claims or deletes it
        inside the block.
    """
    directory = Path(directory)
    mark, found, foreign = directory / OWNER_FILE, "", False
    try:
        if mark.exists():
            found = mark.read_text(encoding="utf-8", errors="replace").strip() or "nobody"
        elif directory.exists():  # parts remain of interrupted runs
            foreign = not all(path.name.startswith(".") and path.suffix == ".part" for path in directory.iterdir())
    except OSError as error:
        raise ResultsError(f"{directory}: {error.strerror or error}; use another --out") from error
    (before, _, old_file), (now, _, file) = found.partition("\n"), owner.partition("\n")
    edited = before != now and bool(file) and file == old_file
    if (foreign or (before not in ("", now) and not edited)) and not force:
        words = "contains files of other programs" if foreign else "holds results of another scene"
        raise ResultsError(f"{directory}: {words}; use another --out, or --force")
    if edited:
        _LOG.warning("%s: results of the scene before its edit are replaced", directory)
    write_text(mark, owner + "\n")
    try:
        yield directory
    except BaseException:
        with suppress(OSError):
            if [path.name for path in directory.iterdir()] == [OWNER_FILE]:
                mark.unlink()
        raise
    if not mark.exists() or mark.read_text(encoding="utf-8", errors="replace").strip() != owner:
        raise ResultsError(f"{directory}: was deleted or overwritten by another command; repeat this one")
