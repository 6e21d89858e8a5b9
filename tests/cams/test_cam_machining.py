"""Machining: followers on the exported points keep the law, the cutter fits, drawing and DXF are true to scale."""

import csv
import re
from functools import partial
from io import StringIO
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
from cam_samples import BY_NAME, FOLLOWERS, KINDS, SMOOTH, STROKE, direction
from cam_samples import made as made_of
from hypothesis import given
from hypothesis import strategies as st
from sampling import examples

from compact.cams import workshop_drawing
from compact.cams.machining import cut, follower_on_polygon, largest_cutter
from compact.cams.profile import Cam, FlatFace, Pointed, RollerFollower

BREADTH, MICROMETRE = 0.9, 1e-6
made = partial(made_of, breadth=BREADTH)
ALL_ROUND = 2 * np.pi * (np.arange(5003) + 0.3217) / 5003  # angles that are no points' angles
SQUARE = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])


def off_the_law(points, cam):
    return np.abs(follower_on_polygon(points, cam.follower, ALL_ROUND) - cam.radius(ALL_ROUND)).max()


def from_svg(text):
    """Points [m] of the profile in an SVG drawing."""
    profile = next(e for e in ElementTree.fromstring(text).iter() if e.get("class") == "PROFILE")
    return np.array([pair.split(",") for pair in profile.get("points").split()], float) * (1e-3, -1e-3)


# (a) closed forms


@pytest.mark.parametrize(
    ("follower", "angle", "exact"),
    [
        (FlatFace(), 0.0, 1.0),
        (FlatFace(), 0.3, np.cos(0.3) + np.sin(0.3)),
        (Pointed(), 0.3, 1 / np.cos(0.3)),
        (Pointed(), np.pi / 4, np.sqrt(2)),
        (RollerFollower(0.5), np.pi, 1.5),
        (RollerFollower(0.5), 0.3, 1.5 / np.cos(0.3)),
        (RollerFollower(0.5), np.pi / 4, np.sqrt(2) + 0.5),
        (RollerFollower(0.5), 0.7, np.cos(0.7) + np.sin(0.7) + np.sqrt(0.25 - (np.cos(0.7) - np.sin(0.7)) ** 2)),
    ],
)
def test_followers_on_edges_and_vertices_of_a_square(follower, angle, exact):
    turned = np.array([angle, angle + np.pi / 2, angle - 6 * np.pi])
    assert follower_on_polygon(SQUARE, follower, turned) == pytest.approx(exact, rel=1e-14)


def test_cutter_path_of_a_harmonic_cam_is_a_circle():
    one = cut(made("harmonic", FlatFace()), cutter_radius=0.025)
    centre = np.array([-STROKE / 2, 0.0])
    assert np.hypot(*(one.profile - centre).T) == pytest.approx(BREADTH / 2, abs=1e-9)
    assert np.hypot(*(one.cutter_path - centre).T) == pytest.approx(BREADTH / 2 + 0.025, abs=1e-9)


def test_hollow_of_a_limacon():
    """rho = A - B cos(phi) is hollow at 0 for A < 2 B; its radius of curvature there is (A - B)^2/(2 B - A)."""
    cam = made("harmonic", Pointed(), breadth=0.6)
    assert cam.least_hollow_radius == pytest.approx(0.1, rel=1e-9)
    assert largest_cutter(cam) == pytest.approx(0.1, rel=1e-9)


def test_cutter_of_the_roller_radius_moves_along_the_pitch_curve():
    cam = made("reversal-4", RollerFollower(0.03))
    one = cut(cam, cutter_radius=0.03)
    assert one.cutter_path == pytest.approx((cam.radius(one.angle) * direction(one.angle)).T, abs=1e-9)


# (b) order


@pytest.mark.sampled(1)
@pytest.mark.parametrize("follower", FOLLOWERS, **BY_NAME)
def test_number_of_points_grows_as_the_root_of_the_tolerance(follower):
    cam, tolerances = made("reversal-3", follower), np.array([1e-5, 1e-6, 1e-7])
    counts = [len(cut(cam, tolerance=tolerance).angle) for tolerance in tolerances]
    assert np.polyfit(np.log(tolerances), np.log(counts), 1)[0] == pytest.approx(-0.5, abs=0.02)


# (c) the promise: the law within a micrometre, from the points alone

HARD = {
    "dwells": ("quintic", {"far_dwell": 0.5, "near_dwell": 2.0}),
    "short run-up": ("reversal-4", {"run_up": 0.05, "run_down": 0.05, "breadth": 4.0}),
    "layers at the ends": ("complex", {"energy_weight": 0.999, "acceleration_weight": 0.0009, "breadth": 2.5}),
}


@pytest.mark.sampled(10)
@pytest.mark.parametrize(
    ("follower", "name"),
    [
        *((follower, name) for follower in FOLLOWERS for name in (*KINDS, *HARD)),
        *(pytest.param(FOLLOWERS[1], name, marks=pytest.mark.slow) for name in sorted(set(SMOOTH) - set(KINDS))),
    ],
    **BY_NAME,
)
def test_follower_on_the_polygon_keeps_its_law_to_a_micrometre(follower, name):
    law, options = HARD.get(name, (name, {}))
    cam = made(law, follower, **options)
    one = cut(cam)
    assert off_the_law(one.profile, cam) <= MICROMETRE
    assert one.error <= MICROMETRE
    assert len(one.angle) < (2500 if not options else 20_000)


# (d) hard cases


@pytest.mark.parametrize("follower", FOLLOWERS[1:], **BY_NAME)
def test_cam_just_above_its_least_breadth_can_be_machined(follower):
    cam = made("reversal-4", follower)
    cam = Cam(cam.cycle, 1.001 * cam.least_breadth().breadth, follower)
    assert off_the_law(cut(cam).profile, cam) <= MICROMETRE


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["combined-2", "reversal-3", "harmonic"])
def test_largest_cutter_touches_the_profile_and_removes_nothing(name):
    cam = made(name, RollerFollower(0.05), breadth=0.55 + 0.05)
    limit = largest_cutter(cam)
    one = cut(cam, cutter_radius=limit * (1 - 1e-9))
    nearest = [np.hypot(*(one.profile - centre).T).min() for centre in one.cutter_path[::7]]
    assert np.array(nearest) == pytest.approx(limit, abs=2e-9)
    with pytest.raises(ValueError, match="to fit the concave parts") as refused:
        cut(cam, cutter_radius=limit * 1.001)
    stated = float(re.search(r"at most (\S+) m", str(refused.value))[1])
    assert cut(cam, cutter_radius=stated).cutter_radius == pytest.approx(limit, rel=1e-6)


# (e) properties


@examples(20, slow=60)
@given(st.integers(3, 40), st.floats(0.0, 0.6), st.floats(1e-3, 5.0), st.integers(0, 2**32 - 1))
def test_roller_touches_its_polygon_without_overlap(corners, unevenness, radius, seed):
    random = np.random.default_rng(seed)
    polar = 2 * np.pi * np.arange(corners) / corners
    outline = ((1 + unevenness * random.random(corners)) * direction(polar)).T
    angle = random.uniform(0, 2 * np.pi, 40)
    rho = follower_on_polygon(outline, RollerFollower(radius), angle)
    start, edge = outline, np.roll(outline, -1, axis=0) - outline
    for centre in (rho * direction(angle)).T:
        share = np.clip(np.sum((centre - start) * edge, axis=1) / np.sum(edge**2, axis=1), 0, 1)
        nearest = np.hypot(*(start + share[:, None] * edge - centre).T).min()
        assert nearest == pytest.approx(radius, rel=1e-9, abs=1e-12)


# files


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Cam, and the texts of its points, drawing and DXF."""
    cam = made("reversal-3", RollerFollower(0.03))
    paths = workshop_drawing.write_cam_files(tmp_path_factory.mktemp("cams"), cam, cutter_radius=0.02, bore=0.06)
    assert [path.name for path in paths] == [f"reversal-3-roller.{ending}" for ending in ("csv", "svg", "dxf")]
    return cam, *(path.read_text(encoding="utf-8") for path in paths)


def test_points_of_the_table_keep_the_law(files):
    cam, table, *_ = files
    rows = [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(StringIO(table))]
    points = np.array([(row["x_mm"], row["y_mm"]) for row in rows]) / 1e3
    assert off_the_law(points, cam) <= MICROMETRE
    polar = [row["radius_mm"] * np.exp(1j * np.radians(row["polar_angle_deg"])) / 1e3 for row in rows]
    assert np.abs(polar - points @ (1, 1j)).max() < 1e-9
    centres = np.array([(row["cutter_x_mm"], row["cutter_y_mm"]) for row in rows]) / 1e3
    assert np.hypot(*(centres - points).T) == pytest.approx(0.02, abs=2e-9)
    assert rows[0]["follower_mm"] == pytest.approx(250.0, abs=1e-9)


def test_drawing_is_true_to_scale_and_keeps_the_law(files):
    cam, _, drawing, _ = files
    root = ElementTree.fromstring(drawing)
    left, top, wide, high = map(float, root.get("viewBox").split())
    assert [root.get(name).removesuffix("mm") for name in ("width", "height")] == root.get("viewBox").split()[2:]
    points = from_svg(drawing)
    assert off_the_law(points, cam) <= MICROMETRE
    assert np.all((1e3 * points > (left, -top - high)) & (1e3 * points < (left + wide, -top)))


def test_dxf_is_valid_and_its_closed_outline_keeps_the_law(files):
    cam, *_, text = files
    document = ezdxf.read(StringIO(text))
    assert not document.audit().has_errors
    assert document.units == ezdxf.units.MM
    (profile,) = document.modelspace().query('LWPOLYLINE[layer=="PROFILE"]')
    assert profile.closed
    points = np.array(profile.get_points("xy"))
    assert np.hypot(*(points[0] - points[-1])) < 3  # no gap where it closes, but a step of the polygon
    assert off_the_law(points / 1e3, cam) <= MICROMETRE
    (cutter,) = document.modelspace().query('LWPOLYLINE[layer=="CUTTER"]')
    assert cutter.closed
    (bore,) = document.modelspace().query('CIRCLE[layer=="BORE"]')
    assert bore.dxf.radius == 30


def test_dimensions_of_the_dxf_measure_the_cam_and_can_be_drawn(files):
    from ezdxf.addons.drawing import Frontend, RenderContext, layout
    from ezdxf.addons.drawing.svg import SVGBackend

    cam, table, drawing, text = files
    document = ezdxf.read(StringIO(text))
    entities = document.modelspace().query('DIMENSION[layer=="DIMENSIONS"]')
    radius = [float(row["radius_mm"]) for row in csv.DictReader(StringIO(table))]
    sizes = {"b = 900": 1e3 * cam.breadth, "R620": max(radius), "R220": min(radius), "Ø60": 60.0, "R30": 30.0}
    assert [entity.get_measurement() for entity in entities] == pytest.approx(list(sizes.values()), abs=1e-6)
    parts = [part for entity in entities for part in entity.virtual_entities()]
    assert [part.text.replace("%%c", "Ø") for part in parts if part.dxftype() == "MTEXT"] == list(sizes)
    assert all(f">{words}</text>" in drawing for words in sizes)
    backend = SVGBackend()
    Frontend(RenderContext(document), backend).draw_layout(document.modelspace())  # an invalid dimension raises
    assert len(backend.get_string(layout.Page(297, 210))) > 10_000


# (g) refusals


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: cut(made("reversal-4", FlatFace(), breadth=0.6)),
            r"undercut: its breadth must exceed 0\.70\d+ m \(the profile",
        ),
        (
            lambda: cut(made("constant-velocity", Pointed())),
            "corner where the velocity of the law jumps, at the angle 0",
        ),
        (
            lambda: cut(made("harmonic", Pointed(), breadth=0.6), cutter_radius=0.2),
            r"`cutter_radius` must be at most 0\.09999999 m to fit .* got 0\.2 m; use a smaller cutter",
        ),
        (
            lambda: workshop_drawing.workshop_drawing(cut(made("harmonic", FlatFace())), bore=0.5),
            r"`bore` must be positive and below 0\.5 m, the smallest diameter",
        ),
        (lambda: follower_on_polygon(SQUARE, FlatFace(), np.array([np.nan])), r"`angle` must be finite, got \[nan\]"),
    ],
)
def test_cams_and_cutters_that_do_not_fit_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
