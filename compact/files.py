"""Writing results so that none is lost or half-written: aside first, then renamed; never over another scene's.

A results directory belongs to the scene whose fingerprint its file `scene.hash` holds.
"""

import csv
import json
import math
import os
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

OWNER_FILE = "scene.hash"
FIGURE_DPI = 110
NETCDF_CLASSIC, NETCDF_HDF5 = "NETCDF3_CLASSIC", "NETCDF4"  # numbers alone, for any reader; strings too
NETCDF_BACKENDS = {NETCDF_CLASSIC: "scipy", NETCDF_HDF5: "h5netcdf"}  # of xarray
GENERIC_STEM = "scene"  # of the file that `compact new` writes into a folder of the user's name


class ResultsError(RuntimeError):
    """A result could not be written, or stands where another scene's stands."""


@contextmanager
def atomic_file(path, mode="w"):
    """Open a file that appears under `path` whole, when the block ends without an error, or not at all."""
    path = Path(path).resolve()  # a link is followed, not replaced
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    options = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    try:
        if path.exists() and not path.is_file():
            raise ResultsError(f"{path}: is no regular file; give another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        with aside.open(mode, **options) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        aside.replace(path)
    except OSError as error:
        raise ResultsError(f"{path}: could not be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # of a path that cannot be there is nothing to remove
            aside.unlink(missing_ok=True)


def default_directory(scene_path, suffix=""):
    """Directory for the results of a scene file if the caller names none: `out/NAME` or `out/NAME-SUFFIX`.

    NAME is the name of the file without its ending. For a file `scene.toml` NAME is the name of its folder, so that
    `a/scene.toml` and `b/scene.toml` have separate results.
    """
    path = Path(scene_path)
    name = path.stem
    if name == GENERIC_STEM:
        name = path.resolve().parent.name or name  # the root of the file system has no name
    return Path("out") / (f"{name}-{suffix}" if suffix else name)


def write_csv(path, header, rows):
    """Write rows of numbers and words under a header of names with units, numbers with 12 digits; the path."""
    with atomic_file(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([_cell(value) for value in row] for row in rows)
    return path


def write_columns(path, header, columns):
    """Write arrays, columns of numbers alone, as `write_csv` does and in a third of the time; the path."""
    line = ",".join(["%.12g"] * len(columns)) + "\n"
    with atomic_file(path) as stream:
        stream.write(",".join(header) + "\n")
        stream.writelines(line % row for row in zip(*(column.tolist() for column in columns), strict=True))
    return path


def _cell(value):
    return f"{value:.12g}" if isinstance(value, float) else value


def write_json(path, content):
    """JSON with infinities as "infinite" and nan as null, since JSON has no words for them."""
    with atomic_file(path) as stream:
        json.dump(_plain(content), stream, indent=2, allow_nan=False)
        stream.write("\n")


def _plain(value):
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "infinite" if value > 0 else "-infinite"
    return value


def write_bytes(path, content):
    """Write bytes as they are; the path."""
    with atomic_file(path, "wb") as stream:
        stream.write(content)
    return path


def write_netcdf(path, dataset, kind):
    """Write an xarray Dataset as netCDF of one of NETCDF_BACKENDS; the path."""
    return write_bytes(path, dataset.to_netcdf(format=kind, engine=NETCDF_BACKENDS[kind]))


def read_netcdf(path, kind):
    """The xarray Dataset of a netCDF file of one of NETCDF_BACKENDS, all of it in memory.

    Raises OSError, TypeError or LookupError for a file that is no such netCDF.
    """
    import xarray

    return xarray.load_dataset(path, engine=NETCDF_BACKENDS[kind])


def write_figure(path, figure):
    """Write a matplotlib figure as PNG; the path."""
    return write_bytes(path, render_png(figure))


def render_png(figure):
    """A matplotlib figure as bytes of PNG."""
    held = BytesIO()
    figure.savefig(held, format="png", dpi=FIGURE_DPI)
    return held.getvalue()


def write_vtu(mesh, path):
    """Write a meshio mesh as VTU, whole or not at all."""
    import meshio

    with atomic_file(path, "wb") as stream:  # its name, since meshio opens the file itself
        meshio.write(stream.name, mesh, file_format="vtu")


def write_pvd_collection(path, members):
    """A series of fields as PVD, a collection of ParaView: (value, file) pairs, the value in the place of time."""
    series = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(series, "Collection")
    for value, file in members:
        name = Path(file).relative_to(Path(path).parent).as_posix()
        ElementTree.SubElement(collection, "DataSet", timestep=repr(value), part="0", file=name)
    ElementTree.indent(series)
    with atomic_file(path, "wb") as stream:
        ElementTree.ElementTree(series).write(stream, encoding="utf-8", xml_declaration=True)


@contextmanager
def claimed_directory(directory, scene_hash, force=False):
    """The directory as of `claim`, given back if the block fails before a result is written."""
    directory = claim_directory(directory, scene_hash, force)
    try:
        yield directory
    except BaseException:
        with suppress(OSError):
            if [path.name for path in directory.iterdir()] == [OWNER_FILE]:
                (directory / OWNER_FILE).unlink()
        raise


def claim_directory(directory, scene_hash, force=False):
    """The directory, made if need be and marked as this scene's; refused where another scene's results stand.

    With `force` the other scene's results are overwritten file by file. Raises ResultsError.
    """
    directory = Path(directory)
    mark = directory / OWNER_FILE
    try:
        owner = mark.read_text(encoding="utf-8", errors="replace").strip() if mark.exists() else None
        foreign = owner is None and directory.exists() and any(map(_is_foreign, directory.iterdir()))
    except OSError as error:
        raise ResultsError(f"{directory}: {error.strerror or error}; give another --out") from error
    if foreign and not force:
        raise ResultsError(f"{directory}: holds files that are not compact's; give another --out, or --force")
    if owner not in (None, scene_hash) and not force:
        raise ResultsError(f"{directory}: holds results of another scene; give another --out, or --force")
    with atomic_file(mark) as stream:
        stream.write(scene_hash + "\n")
    return directory


def _is_foreign(path):
    """Whether a file is more than what a killed run had set aside."""
    return not (path.name.startswith(".") and path.name.endswith(".part"))
