"""Results on disk: whole or not at all, read back as written, never over another scene's; every failure in words."""

import contextlib
import csv
import errno
import json
import math
import os
import shutil
import stat
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact.files import (
    OWNER_FILE,
    ResultsError,
    atomic_file,
    claim_directory,
    claimed_directory,
    read_table,
    read_vtu_series,
    source_hash,
    write_csv,
    write_json,
    write_vtu_series,
)


@pytest.mark.parametrize(
    ("name", "content", "changes"),
    [("law.py", "b = 2", True), ("table.csv", "1", True), ("other.py", "a = 1", True), ("note.txt", "new", False)],
)
def test_hash_of_the_sources_follows_every_edit(tmp_path, name, content, changes):
    (tmp_path / "law.py").write_text("a = 1")
    before = source_hash(tmp_path)
    (tmp_path / name).write_text(content)
    assert (source_hash(tmp_path) != before) == changes


def names(directory):
    return sorted(path.name for path in directory.iterdir())


def no_space(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write_half(path, broken_by):
    with atomic_file(path) as stream:
        stream.write("half")
        raise broken_by


# whole or not at all


def test_file_appears_when_the_block_ends(tmp_path):
    path = tmp_path / "a" / "b" / "result.txt"
    with atomic_file(path) as stream:
        stream.write("whole")
        stream.flush()
        assert not path.exists()
    assert path.read_text() == "whole"
    assert names(path.parent) == ["result.txt"]


def test_bytes_are_kept(tmp_path):
    with atomic_file(tmp_path / "picture.png", "wb") as stream:
        stream.write(b"\x89PNG\r\n\x00")
    assert (tmp_path / "picture.png").read_bytes() == b"\x89PNG\r\n\x00"


def test_words_are_utf8_with_plain_line_ends(tmp_path):
    with atomic_file(tmp_path / "words") as stream:
        stream.write("δ\n")
    assert (tmp_path / "words").read_bytes() == "δ\n".encode()


@pytest.mark.parametrize("broken_by", [ZeroDivisionError, KeyboardInterrupt, SystemExit, MemoryError])
@pytest.mark.parametrize("old", [None, "old"])
def test_broken_block_leaves_what_was_there(tmp_path, broken_by, old):
    path = tmp_path / "result.txt"
    if old:
        path.write_text(old)
    with pytest.raises(broken_by):
        write_half(path, broken_by)
    assert names(tmp_path) == (["result.txt"] if old else [])
    assert not old or path.read_text() == old


def test_old_content_is_read_until_the_new_is_whole(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with path.open() as reader:
        with atomic_file(path) as stream:
            stream.write("new, longer")
            assert path.read_text() == "old"
        assert reader.read() == "old"
    assert path.read_text() == "new, longer"


def test_two_files_of_one_directory_do_not_meet(tmp_path):
    with atomic_file(tmp_path / "a") as first, atomic_file(tmp_path / "b") as second:
        first.write("1")
        second.write("2")
    assert [(tmp_path / name).read_text() for name in "ab"] == ["1", "2"]


# a disk that fails


@pytest.mark.parametrize("failing", ["fsync", "flush", "replace"])
def test_full_disk_is_told_and_leaves_nothing(tmp_path, monkeypatch, failing):
    path = tmp_path / "result.txt"
    path.write_text("old")
    if failing == "fsync":
        monkeypatch.setattr(os, "fsync", no_space)
    elif failing == "replace":
        monkeypatch.setattr(Path, "replace", no_space)
    told = pytest.raises(ResultsError, match=r"result\.txt: could not be written: No space left on device")
    with told, atomic_file(path) as stream:
        stream.write("new")
        if failing == "flush":
            no_space()
    monkeypatch.undo()
    assert names(tmp_path) == ["result.txt"]
    assert path.read_text() == "old"


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs the device that is always full")
@pytest.mark.parametrize("size", [10, 10**6], ids=["in the buffer", "beyond the buffer"])
def test_really_full_device_is_told(tmp_path, monkeypatch, size):
    """The file set aside is opened on /dev/full; the device itself is never named, since it would be replaced."""
    plain = Path.open
    monkeypatch.setattr(Path, "open", lambda self, *args, **options: plain(Path("/dev/full"), *args, **options))
    with pytest.raises(ResultsError, match="could not be written: No space left on device"):
        write_csv(tmp_path / "table.csv", ("a",), [("x" * size,)])
    monkeypatch.undo()
    assert names(tmp_path) == []


def test_directory_in_the_way_is_told(tmp_path):
    (tmp_path / "result.csv").mkdir()
    with pytest.raises(ResultsError, match=r"result\.csv: not a regular file; use another name"):
        write_csv(tmp_path / "result.csv", ("a",), [])
    assert names(tmp_path) == ["result.csv"]


def test_directory_that_cannot_be_made_is_told():
    with pytest.raises(ResultsError, match=r"/proc/compact/result\.csv: could not be written"):
        write_csv("/proc/compact/result.csv", ("a",), [])


@pytest.mark.parametrize("call", ["open", "mkdir"])
def test_forbidden_directory_is_told(tmp_path, monkeypatch, call):
    def forbidden(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, call, forbidden)
    with pytest.raises(ResultsError, match="could not be written: Permission denied"):
        write_csv(tmp_path / "result.csv", ("a",), [])


def below_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    return tmp_path / "file" / "result.csv"


def named_too_long(tmp_path):
    return tmp_path / ("x" * 300)


@pytest.mark.parametrize("path_in", [below_a_file, named_too_long])
def test_path_that_cannot_be_is_told(tmp_path, path_in):
    path = path_in(tmp_path)
    with pytest.raises(ResultsError, match="could not be written"):
        write_csv(path, ("a",), [])


def test_what_is_not_a_file_is_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(ResultsError, match="pipe: not a regular file; use another name"):
        write_csv(pipe, ("a",), [])
    assert stat.S_ISFIFO(pipe.stat().st_mode)


# tables and JSON


def test_table_reads_back(tmp_path):
    rows = [("cubic", 1 / 3, 4), ('a, "b"\nδ', np.float64(2e-300), True), ("none", None, np.int64(7))]
    write_csv(tmp_path / "t.csv", ("law", "peak_force_N", "n"), rows)
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as stream:
        got = list(csv.reader(stream))
    assert got[0] == ["law", "peak_force_N", "n"]
    assert got[1] == ["cubic", "0.333333333333", "4"]
    assert got[2] == ['a, "b"\nδ', "2e-300", "True"]
    assert got[3] == ["none", "", "7"]


def test_table_holds_infinities_in_words_that_float_reads(tmp_path):
    write_csv(tmp_path / "t.csv", ("a", "b", "c"), [(math.inf, -math.inf, math.nan)])
    assert (tmp_path / "t.csv").read_text() == "a,b,c\ninf,-inf,nan\n"


def test_table_that_breaks_half_way_leaves_the_old(tmp_path):
    write_csv(tmp_path / "t.csv", ("a",), [(1.0,)])
    with pytest.raises(ZeroDivisionError):
        write_csv(tmp_path / "t.csv", ("a",), ((1 / i,) for i in (2, 1, 0)))
    assert (tmp_path / "t.csv").read_text() == "a\n1\n"
    assert names(tmp_path) == ["t.csv"]


@given(st.lists(st.floats(), max_size=5))
def test_numbers_of_a_table_keep_twelve_digits(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("table") / "t.csv"
    write_csv(path, ("a",), [(value,) for value in values])
    got = [float(line) for line in path.read_text().splitlines()[1:]]
    assert got == pytest.approx(values, rel=5.1e-12, abs=5e-324, nan_ok=True)


def test_json_says_infinity_in_a_word_and_nan_with_null(tmp_path):
    content = {"a": math.inf, "b": [-math.inf, math.nan], "c": np.array([[1.0, np.nan], [np.inf, 2.0]])}
    write_json(tmp_path / "s.json", content | {"d": np.float32(np.inf)})
    got = json.loads((tmp_path / "s.json").read_text(), parse_constant=pytest.fail)
    assert got == {
        "a": "infinite",
        "b": ["-infinite", None],
        "c": [[1.0, None], ["infinite", 2.0]],
        "d": "infinite",
    }


def test_json_takes_numpy_and_tuples(tmp_path):
    content = {3: (np.int64(4), np.float64(0.1), np.bool_(True)), "none": None, "δ": {"deep": [()]}}
    write_json(tmp_path / "s.json", content)
    assert json.loads((tmp_path / "s.json").read_text()) == {"3": [4, 0.1, True], "none": None, "δ": {"deep": [[]]}}
    assert (tmp_path / "s.json").read_text().endswith("}\n")


def test_json_that_cannot_be_written_leaves_the_old(tmp_path):
    write_json(tmp_path / "s.json", {"a": 1})
    with pytest.raises(TypeError):
        write_json(tmp_path / "s.json", {"a": {1, 2}})
    assert json.loads((tmp_path / "s.json").read_text()) == {"a": 1}
    assert names(tmp_path) == ["s.json"]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text('aδ\n"\\'),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abδ", max_size=3), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text("abδ", max_size=3), json_values, max_size=4))
def test_json_reads_back_as_it_was(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("json") / "s.json"
    write_json(path, content)
    assert json.loads(path.read_text(encoding="utf-8")) == content


# a series of fields


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


# tables


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
        (b"load\n1\n1,2\n", r"t\.csv:3: a row must have one cell for each of 1 columns, got 2"),
        (b"\xff", r"t\.csv: cannot be read: .*decode"),
    ],
)
def test_invalid_table_is_refused_with_its_line(tmp_path, content, message):
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_table(tmp_path / "t.csv", ("load",))


# whose directory


@pytest.mark.parametrize("made", [False, True], ids=["new", "empty"])
def test_free_directory_is_claimed(tmp_path, made):
    directory = tmp_path / "out" / "scene"
    if made:
        directory.mkdir(parents=True)
    assert claim_directory(directory, "abc") == directory
    assert (directory / OWNER_FILE).read_text() == "abc\n"


def test_own_directory_is_used_again(tmp_path):
    claim_directory(tmp_path / "out", "abc")
    write_json(tmp_path / "out" / "summary.json", {})
    assert claim_directory(str(tmp_path / "out"), "abc") == tmp_path / "out"
    assert names(tmp_path / "out") == [OWNER_FILE, "summary.json"]


def test_directory_of_another_scene_is_refused(tmp_path):
    claim_directory(tmp_path, "abc")
    with pytest.raises(ResultsError, match="holds results of another scene; use another --out, or --force"):
        claim_directory(tmp_path, "xyz")
    assert (tmp_path / OWNER_FILE).read_text() == "abc\n"


def test_force_takes_the_directory_of_another_scene(tmp_path):
    claim_directory(tmp_path, "abc")
    write_json(tmp_path / "summary.json", {})
    claim_directory(tmp_path, "xyz", force=True)
    assert (tmp_path / OWNER_FILE).read_text() == "xyz\n"
    assert names(tmp_path) == [OWNER_FILE, "summary.json"]


def test_foreign_files_are_refused_and_kept_under_force(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ResultsError, match="contains files of other programs; use another --out, or --force"):
        claim_directory(tmp_path, "abc")
    assert names(tmp_path) == ["thesis.tex"]
    claim_directory(tmp_path, "abc", force=True)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("force", [False, True])
def test_file_in_the_way_is_refused(tmp_path, force):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(ResultsError, match="out: Not a directory; use another --out"):
        claim_directory(tmp_path / "out", "abc", force)
    assert (tmp_path / "out").read_text() == "a file"


def test_directory_that_may_not_be_read_is_told(tmp_path, monkeypatch):
    def forbidden(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "iterdir", forbidden)
    with pytest.raises(ResultsError, match="Permission denied; use another --out"):
        claim_directory(tmp_path, "abc")


def test_place_where_nothing_can_be_written_is_told():
    with pytest.raises(ResultsError, match=r"/proc/compact/scene\.hash: could not be written"):
        claim_directory("/proc/compact", "abc")


def test_directory_as_a_mark_is_refused(tmp_path):
    (tmp_path / OWNER_FILE).mkdir()
    with pytest.raises(ResultsError, match="Is a directory; use another --out"):
        claim_directory(tmp_path, "abc")


def fail_in(directory, scene_hash, result=None):
    with claimed_directory(directory, scene_hash) as place:
        if result:
            (place / result).write_text("whole")
        raise ZeroDivisionError


def test_claim_of_a_run_that_wrote_nothing_is_given_back(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path, "abc")
    with claimed_directory(tmp_path, "xyz") as directory:
        assert (directory / OWNER_FILE).read_text() == "xyz\n"


def test_claim_of_a_run_that_wrote_something_stays(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path, "abc", "laws.csv")
    with pytest.raises(ResultsError, match="another scene"):
        claim_directory(tmp_path, "xyz")


def delete_and_write(out, error):
    with claimed_directory(out, "abc"):
        shutil.rmtree(out)
        write_json(out / "later.json", {})
        if error:
            raise error


@pytest.mark.parametrize(
    ("error", "told"),
    [(None, ResultsError), (FileNotFoundError, ResultsError), (KeyboardInterrupt, KeyboardInterrupt)],
)
def test_deleted_directory_is_told_and_continued_by_the_same_command(tmp_path, error, told):
    out = tmp_path / "out"
    with pytest.raises(told) as raised:
        delete_and_write(out, error)
    assert ("was deleted while its results were written" in str(raised.value)) == (told is ResultsError)
    assert names(out) == sorted(["later.json", OWNER_FILE])
    claim_directory(out, "abc")


def test_directory_that_another_command_overwrites_is_told(tmp_path):
    with pytest.raises(ResultsError, match="overwritten by another command"), claimed_directory(tmp_path, "abc"):
        claim_directory(tmp_path, "xyz", force=True)
    assert (tmp_path / OWNER_FILE).read_text() == "xyz\n"


def test_empty_mark_is_another_scene(tmp_path):
    (tmp_path / OWNER_FILE).write_text("")
    with pytest.raises(ResultsError, match="another scene"):
        claim_directory(tmp_path, "abc")


def test_unreadable_mark_is_refused(tmp_path):
    (tmp_path / OWNER_FILE).write_bytes(b"\xff\xfe")
    with pytest.raises(ResultsError, match="another scene"):
        claim_directory(tmp_path, "abc")


def test_remains_of_a_killed_claim_do_not_lock_the_directory(tmp_path):
    (tmp_path / f".{OWNER_FILE}.4711.part").write_text("")
    with contextlib.suppress(ResultsError):
        claim_directory(tmp_path, "abc")
    assert (tmp_path / OWNER_FILE).exists()
