"""Tables: one declaration for CSV, page, notebook, data frame and dataset."""

from types import SimpleNamespace

import numpy as np

from compact.report.tables import TableSpec, json_numbers

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
