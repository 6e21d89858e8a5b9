"""Results on disk and tables: whole or not at all, read back as written; every failure in words."""

import csv
import errno
import json
import math
import os
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

from compact.cli import program as cli
from compact.files import (
    OWNER_FILE,
    ResultsError,
    atomic_file,
    claimed_directory,
    read_table,
    read_vtu_series,
    write_csv,
    write_json,
    write_vtu_series,
)
from compact.report.tables import TableSpec, json_numbers


def claim_directory(*arguments, **options):
    with claimed_directory(*arguments, **options) as directory:
        return directory


def names(directory):
    return sorted(path.name for path in directory.iterdir())


# whole or not at all


@pytest.mark.parametrize(("mode", "new"), [("w", "δ, longer\n"), ("wb", b"\x89PNG\r\n\x00")])
@pytest.mark.parametrize("old", [None, b"old"])
def test_file_appears_whole_when_the_block_ends(tmp_path, mode, new, old):
    path = tmp_path / "a" / "b" / "result"
    path.parent.mkdir(parents=old is not None) if old else None
    if old:
        path.write_bytes(old)
    with atomic_file(path, mode) as stream, atomic_file(path.with_name("other")) as other:
        stream.write(new)
        other.write("2")
        stream.flush()
        assert (path.read_bytes() if path.exists() else None) == old
    assert path.read_bytes() == (new if mode == "wb" else new.encode())
    assert names(path.parent) == ["other", "result"]


@pytest.mark.parametrize("broken_by", [ZeroDivisionError, KeyboardInterrupt, SystemExit, MemoryError])
@pytest.mark.parametrize("old", [None, "old"])
def test_broken_block_leaves_what_was_there(tmp_path, broken_by, old):
    path = tmp_path / "result.txt"
    if old:
        path.write_text(old)

    def write_half():
        with atomic_file(path) as stream:
            stream.write("half")
            raise broken_by

    with pytest.raises(broken_by):
        write_half()
    assert names(tmp_path) == (["result.txt"] if old else [])
    assert not old or path.read_text() == old


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_full_disk_is_told_and_leaves_nothing(tmp_path, monkeypatch, failing):
    def no_space(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "result.txt"
    path.write_text("old")
    monkeypatch.setattr(os if failing == "fsync" else Path, failing, no_space)
    told = pytest.raises(ResultsError, match=r"result\.txt: could not be written: No space left on device")
    with told, atomic_file(path) as stream:
        stream.write("new")
    monkeypatch.undo()
    assert names(tmp_path) == ["result.txt"]
    assert path.read_text() == "old"


# tables and JSON


def test_table_reads_back(tmp_path):
    rows = [("cubic", 1 / 3, 4), ('a, "b"\nδ', np.float64(2e-300), True), (None, math.inf, np.int64(7))]
    write_csv(tmp_path / "t.csv", ("law", "peak_force_N", "n"), rows)
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as stream:
        header, *got = csv.reader(stream)
    assert header == ["law", "peak_force_N", "n"]
    assert got == [["cubic", "0.333333333333", "4"], ['a, "b"\nδ', "2e-300", "True"], ["", "inf", "7"]]


def test_json_takes_numpy_and_says_infinity_in_a_word_and_nan_with_null(tmp_path):
    content = {
        "a": math.inf, "b": [-math.inf, math.nan], "c": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "d": np.float32(np.inf), 3: (np.int64(4), np.float64(0.1), np.bool_(True)), "none": None, "δ": {"deep": [()]},
    }  # fmt: skip
    write_json(tmp_path / "s.json", content)
    assert json.loads((tmp_path / "s.json").read_text(), parse_constant=pytest.fail) == {
        "a": "infinite", "b": ["-infinite", None], "c": [[1.0, None], ["infinite", 2.0]], "d": "infinite",
        "3": [4, 0.1, True], "none": None, "δ": {"deep": [[]]},
    }  # fmt: skip


def test_series_names_its_files_from_its_own_place(tmp_path):
    mesh = meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])])
    frames = [(value, mesh) for value in (0.02, 1 / 3)]
    assert list(write_vtu_series(tmp_path / "fields.pvd", "fields", "speed", frames))[-1] == tmp_path / "fields.pvd"
    root = ElementTree.parse(tmp_path / "fields.pvd").getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    members = {float(member.get("timestep")): member.get("file") for member in root.iter("DataSet")}
    assert members == {0.02: "fields/speed=0.02.vtu", 1 / 3: "fields/speed=0.3333333333333333.vtu"}
    parameter, read = read_vtu_series(tmp_path / "fields.pvd")
    assert (parameter, [value for value, _ in read]) == ("speed", [0.02, 1 / 3])


def test_table_is_read_by_columns_without_its_comments(tmp_path):
    (tmp_path / "t.csv").write_text('# of 2024\nname, load\n\n "a, b" , 3\n# two\nc,4\n', encoding="utf-8")
    assert read_table(tmp_path / "t.csv", ("load",)) == [
        (4, {"name": "a, b", "load": "3"}),
        (6, {"name": "c", "load": "4"}),
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"t\.csv:1: lacks the columns load"),
        (b"#\nname\n", r"t\.csv:2: lacks the columns load"),
        (b"load,load\n", r"t\.csv:1: each column must have a name of its own, got load, load"),
        (b"load\n1\n1,2\n", r"t\.csv:3: must have a cell for each of 1 columns, got 2"),
        (b"\xff", r"t\.csv: cannot be read: .*decode"),
    ],
)
def test_invalid_table_is_refused_with_its_line(tmp_path, content, message):
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_table(tmp_path / "t.csv", ("load",))


# whose directory


@pytest.mark.parametrize("found", [(), ("empty",), ("own",), ("killed",)], ids=lambda found: "".join(found) or "new")
def test_free_or_own_directory_is_claimed(tmp_path, found):
    directory = tmp_path / "out" / "scene"
    if found:
        directory.mkdir(parents=True)
    if "own" in found:
        claim_directory(str(directory), "abc")
    if "killed" in found:
        (directory / f".{OWNER_FILE}.4711.part").write_text("")  # remains of a claim
    assert claim_directory(directory, "abc") == directory
    assert (directory / OWNER_FILE).read_text() == "abc\n"


FOREIGN = {  # files of a directory, and words of the refusal
    "another scene": ({OWNER_FILE: b"xyz\n"}, "holds results of another scene; use another --out, or --force"),
    "other programs": ({"thesis.tex": b"work"}, "contains files of other programs; use another --out, or --force"),
}


@pytest.mark.parametrize("case", FOREIGN)
def test_directory_of_others_is_refused_and_kept_under_force(tmp_path, case):
    files, words = FOREIGN[case]
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ResultsError, match=words):
        claim_directory(tmp_path, "abc")
    assert {name: (tmp_path / name).read_bytes() for name in names(tmp_path)} == files
    claim_directory(tmp_path, "abc", force=True)
    assert (tmp_path / OWNER_FILE).read_text() == "abc\n"
    assert set(files) <= set(names(tmp_path))


def test_results_of_an_edited_scene_file_are_replaced_and_nothing_else_is(tmp_path, monkeypatch, capsys, caplog):
    monkeypatch.chdir(tmp_path)
    scene = Path("mine/scene.toml")
    roll = ["roll", str(scene), "--engine", "formula", "--set", "layer.lift_thickness="]
    assert cli._exit_code(["new", "mine"]) == cli._exit_code(roll) == 0
    notes = next(Path("out").glob("mine-*")) / "notes.txt"
    notes.write_text("mine")
    before = (notes.parent / "contact.json").read_text()
    scene.write_text(scene.read_text().replace("moisture = 0.10", "moisture = 0.11"))
    assert cli._exit_code(roll) == 0
    assert caplog.messages == [f"{notes.parent}: results of the scene before its edit are replaced"]
    assert (notes.parent / "contact.json").read_text() != before
    assert notes.read_text() == "mine"
    scene.rename("other.toml")
    roll[1] = "other.toml"
    assert cli._exit_code([*roll, "--set", "mix.moisture=0.12", "--out", str(notes.parent)]) == 1
    assert "holds results of another scene" in capsys.readouterr().err


@pytest.mark.parametrize("result", [None, "laws.csv"])
def test_claim_of_a_failed_run_is_given_back_unless_it_wrote_something(tmp_path, result):
    def fail():
        with claimed_directory(tmp_path, "abc") as place:
            if result:
                (place / result).write_text("whole")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with pytest.raises(ResultsError, match="another scene") if result else nullcontext():
        claim_directory(tmp_path, "xyz")


# ---- Tables: one declaration for CSV, page, notebook, data frame and dataset


RUNS = [
    SimpleNamespace(name="cubic", peak_force=3739.84, rigid=SimpleNamespace(peak_force=1 / 3), motor=None),
    SimpleNamespace(name="quintic", peak_force=np.inf, rigid=None, motor=SimpleNamespace(name="A, 1")),
]
DECLARED = "law=name peak_force_N rigid_peak_force_N=rigid.peak_force motor=motor.name"


def test_table_is_the_same_in_every_form(tmp_path):
    table = TableSpec.of("runs <1>", RUNS, DECLARED, count=lambda run: 7)
    text = table.write(tmp_path / "runs.csv").read_text().splitlines()
    assert text[0] == "law,peak_force_N,rigid_peak_force_N,motor,count"
    assert text[1:] == ["cubic,3739.84,0.333333333333,,7", 'quintic,inf,,"A, 1",7']
    assert table.cells("law", "peak_force", "motor") == {
        "law": ["cubic", "quintic"], "peak drive force": ["3.740 kN", "infinite"], "motor": ["", "A, 1"],
    }  # fmt: skip
    frame = table.to_dataframe("law")
    assert frame.loc["cubic", "peak_force"] == 3739.84
    assert frame.attrs["units"] == {"peak_force": "N", "rigid_peak_force": "N", "count": "1"}
    dataset = table.to_xarray("law", {"engine": "column"})
    assert dataset["peak_force"].attrs == {"units": "N", "long_name": "peak drive force"}
    assert np.isnan(dataset["rigid_peak_force"].sel(law="quintic"))
    html = table.to_html()
    assert "runs &lt;1&gt;" in html
    assert "peak force" in html
    assert "3.740 kN<" in html


def test_record_becomes_numbers_with_units():
    assert json_numbers(RUNS[0], "peak_force_N rigid=rigid.peak_force") == {
        "peak_force": {"value": 3739.84, "unit": "N"}, "rigid": {"value": 1 / 3, "unit": "1"},
    }  # fmt: skip
