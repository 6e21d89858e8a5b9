"""Former keys of summary.json: found under their present names, with a warning."""

import json

import pytest

from compact.report.summary import FORMER_KEYS, read_summary


def test_former_keys_are_found_with_a_warning(tmp_path):
    content = {
        "comparison": {"column": {"evaluation_counts": {"rolled": 2}}},
        "rankings": {"peak_force": [{"resolved": True}]},
    }
    (tmp_path / "summary.json").write_text(json.dumps(content))
    summary = read_summary(tmp_path / "summary.json")
    assert summary == content
    with pytest.warns(DeprecationWarning, match="'beside' of summary.json is now 'comparison'; .* for one release"):
        engine = summary["beside"]["column"]
    with pytest.warns(DeprecationWarning, match="'stages' .* is now 'evaluation_counts'"):
        assert engine["stages"] == {"rolled": 2}
    with pytest.warns(DeprecationWarning, match="'sure' .* is now 'resolved'"):
        assert summary["rankings"]["peak_force"][0]["sure"] is True


@pytest.mark.parametrize("key", [*FORMER_KEYS, "unknown"])
def test_a_key_without_a_present_name_is_missing(key, tmp_path):
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(KeyError, match=key):
        read_summary(tmp_path / "summary.json")[key]
