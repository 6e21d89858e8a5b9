"""HTML page of a study: numbers of the study, no external resources, complete in a browser."""

import json
import re
import shutil
import subprocess
from html import unescape
from importlib.resources import files

import numpy as np
import pytest
from jinja2 import UndefinedError
from pages import PageReader, page_html

from compact.analysis.study import Study
from compact.report import writer as report
from compact.report.page import Picture, Section, render_page
from compact.report.tables import TableSpec, format_column, format_number, format_percent, format_quantity
from compact.scene.loader import load_scene

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SECTIONS = ["ranking", "contact", "uncertainty", "drive", "checks", "explained", "inputs"]
MOST_WORDS, MOST_VISIBLE = 6000, 1200  # of a page, and of its answer


def scene(name="small", **changes):
    return load_scene(name, **changes)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Study, summary and page of the small scene with a layer and cams."""
    wanted = {"output.items": ["report"], "accuracy.engine": "spectral"}
    quick = {"contact.speeds": [0.05, 0.3], "contact.peak_pressure": 203e3, "accuracy.tolerance": 0.05}
    plain = {"machine.gap_geometry": "circle", "machine.roller_condition": "frictionless", "mix.moisture": 0.11}
    study = Study(scene(**wanted, **plain, **quick))
    directory = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("compact.analysis.stages.uncertainty.SAMPLES", 64)
        summary = report.write_study(study, directory)
    return study, summary, directory / "report.html"


# (a) numbers in words


TEXTS = [
    *((format_number, (value,), text) for value, text in [
        (0.0, "0"), (-0.0, "0"), (3739.84, "3740"), (-12.345678, "−12.35"), (1e-7, "1.000 × 10⁻⁷"), (7, "7"),
        (float("inf"), "infinite"), (float("nan"), "–"), (None, "–"), (True, "yes"),
    ]),
    *((format_quantity, (value, unit), text) for value, unit, text in [
        (203e3, "Pa", "203 kPa"), (0.0557, "m", "55.7 mm"), (0.22, "m", "0.22 m"), (-4.2e-6, "m", "−4.2 µm"),
        (1.37e6, "Pa", "1.37 MPa"), (0.179, "1", "0.179"), (0.6, "m/s2", "0.6 m/s²"), (None, "N", "–"),
        (float("inf"), "W", "infinite"),
    ]),
    *((format_percent, (share,), text) for share, text in [
        (0.0106, "1.1 %"), (1.9e-15, "0 %"), (float("nan"), "–"), (None, "–"),
    ]),
    (format_number, (2.5e9, 2), "2.5 × 10⁹"),
    (format_column, ([3739.8, 4207.1], "N"), ["3.740 kN", "4.207 kN"]),
    (format_column, ([0.0, 7.3851, 0.1778], "m/s^3"), ["0.0000 m/s³", "7.3851 m/s³", "0.1778 m/s³"]),
    (format_column, ([float("inf"), None], "N"), ["infinite", "–"]),
]  # fmt: skip


@pytest.mark.parametrize(("form", "given", "text"), TEXTS)
def test_number_has_its_digits_and_the_shortest_prefix(form, given, text):
    assert form(*given) == text


def test_text_is_escaped():
    table = TableSpec.of_columns("<script>", {"<script>": ["<script>"]})
    sections = [Section("name", "<script>", ["<script>", table, Picture(b"", "<script>", "<script>")])]
    told = {"question": "<script>", "recommended": "<b>", "sentences": ["<script>"], "pictures": []}
    page = render_page("<b>", sections=sections, tables=[table], **told)
    assert page.count("<script>") == 1
    assert "<b>" not in page
    with pytest.raises(UndefinedError):
        render_page("page")


# the page says what the study found


def test_page_has_the_numbers_of_the_study_in_every_section_and_not_too_many_words(written):
    study, _, path = written
    page = PageReader(path.read_text("utf-8"))
    words = unescape(page.words).replace("\N{NO-BREAK SPACE}", " ")
    assert [attributes["id"] for attributes in page.all("details") if "id" in attributes] == SECTIONS
    for by, unit in (("peak_force", "N"), ("peak_power", "W")):
        value = format_column([study.stages.drive.rankings[by][0].value], unit, 3)[0]
        assert f"{value} (1)" in words
        first = study.places_by_engine["formula"]["rigid"][by][0]
        assert f"{first.law} {format_column([first.value], unit, 3)[0]}" in words  # in the row of the model
    assert "it omits irreversible compaction" in words
    error = format_percent(study.stages.resistance.map.engine_error)
    assert f"Error estimate of the engine spectral: {error}" in words
    assert len(words.split()) < MOST_WORDS
    assert len(words.partition("Laws by engine and drive")[0].split()) < MOST_VISIBLE


# checks


def test_checks_pass_for_every_contact_and_run(written):
    study, _, _ = written
    found = study.checks
    assert all(check.passed for check in found)
    assert sum("work of the contact" in check.name for check in found) == len(study.stages.contacts.first_passes)
    assert sum("work over a cycle" in check.name for check in found) == len(study.stages.drive.runs)


def test_open_energy_balance_of_a_cycle_fails_its_check():
    study = Study(scene(**{"output.items": [], "motion.laws": ["cubic"]}))
    run = study.stages.drive.runs["cubic"]
    *before, state = run.samples
    vars(run)["samples"] = (*before, state._replace(resistance=1.001 * state.resistance))
    failed = [check for check in study.checks if not check.passed]
    assert [check.name for check in failed] == ["work over a cycle, cubic"]
    assert "Built-in checks that fail:</strong> work over a cycle, cubic." in page_html(study, checks=failed)


# one file, for everybody


def test_page_has_no_external_resources_and_describes_its_pictures(written):
    text = written[2].read_text("utf-8")
    page = PageReader(text)
    assert all(image["src"].startswith("data:image/") for image in page.all("img"))
    assert all(link["href"].startswith("data:") for link in page.all("link"))
    assert not [attributes for attributes in page.all("script") if "src" in attributes]
    assert "@import" not in text
    assert "url(" not in text
    assert "http" not in re.sub(r'src="data:[^"]*"', "", text)
    assert len(page.all("img")) >= 5
    assert all(len(image["alt"]) > 25 for image in page.all("img"))
    assert page.all("html")[0]["lang"] == "en"
    assert len(page.all("h1")) == 1


def test_text_has_sufficient_contrast():
    """WCAG 2.1: contrast at least 4.5."""
    style = (files("compact") / "data" / "page.css").read_text("utf-8")
    pairs = re.findall(r"color: (#[0-9a-f]{3,6}); background: (#[0-9a-f]{3,6})", style)
    pairs += [(colour, "#fff") for colour in re.findall(r"[{ ]color: (#[0-9a-f]{3,6})", style)]
    assert len(pairs) > 8
    assert min(contrast(*pair) for pair in pairs) >= 4.5


def contrast(one, other):
    lighter, darker = sorted(map(luminance, (one, other)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


def luminance(colour):
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    share = np.array([int(digits[i : i + 2], 16) for i in (0, 2, 4)]) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


# in a browser

PROBE = """<script>
const told = [];
addEventListener("error", (event) => told.push(String(event.message || event.target.src).slice(0, 200)), true);
for (const level of ["error", "warn"]) console[level] = (...words) => told.push(words.join(" "));
addEventListener("load", () => {
  const shut = document.querySelectorAll("details:not([open])").length;
  dispatchEvent(new Event("beforeprint"));
  const still = document.querySelectorAll("details:not([open])").length;
  setTimeout(() => parent.postMessage({
    width: innerWidth, scroll: document.documentElement.scrollWidth, shut, still, told,
    images: [...document.images].map((image) => image.naturalWidth),
    boxes: [...document.querySelectorAll(".box")].map((box) => box.getBoundingClientRect().right),
  }, "*"), 300);
});
</script>"""
FRAME = """<body><pre></pre><script>
const tell = (event) => { document.querySelector("pre").textContent += JSON.stringify(event.data) + "\\n"; };
addEventListener("message", tell);
</script>"""


def browsed(text, directory):
    """State of a page in windows of 1280 and 400 px with all sections open, by width."""
    (directory / "page.html").write_text(text.replace("<head>", f"<head>{PROBE}", 1), encoding="utf-8")
    frames = "".join(f'<iframe src="page.html" width="{w}" height="900" frameborder="0"></iframe>' for w in (1280, 400))
    (directory / "frame.html").write_text(FRAME + frames, encoding="utf-8")
    call = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={directory / 'profile'}",
        "--virtual-time-budget=20000", "--dump-dom", str(directory / "frame.html"),
    ]  # fmt: skip
    dom = subprocess.run(call, capture_output=True, text=True, check=True, timeout=300).stdout
    lines = unescape(re.search(r"<pre>(.*?)</pre>", dom, re.DOTALL)[1]).splitlines()
    return {told["width"]: told for told in map(json.loads, lines)}


needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome on the path")


@needs_chromium
def test_browser_shows_the_page_whole_on_a_screen_and_a_phone(written, tmp_path):
    text = written[2].read_text("utf-8")
    told = browsed(text, tmp_path)
    assert told.keys() == {1280, 400}
    for width, shown in told.items():
        assert shown["told"] == []
        assert shown["scroll"] <= width
        assert max(shown["boxes"]) <= width
        assert len(shown["images"]) == len(PageReader(text).all("img"))
        assert min(shown["images"]) > 0
        assert (shown["shut"], shown["still"]) == (len(SECTIONS), 0)  # on paper every section is open
