"""Cams: closed forms, geometry by finite differences, least breadths; the cut law, cutters, drawing and DXF."""

import csv
import re
from dataclasses import replace
from functools import partial
from io import StringIO
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampling import examples

from compact.cams import workshop_drawing
from compact.cams.machining import cut, follower_on_polygon, largest_cutter
from compact.cams.profile import Cam, FlatFace, Pointed, RollerFollower, least_breadth
from compact.motion.profile import LAWS, Cycle, law

STROKE, DURATION = 0.4, 3.0
FOLLOWERS = (Pointed(), RollerFollower(0.03), FlatFace())
SHOCK = ("constant-velocity", "gear-sector")
SMOOTH = [name for name in LAWS if name not in SHOCK]
KINDS = ("quintic", "complex", "reversal-4", "crank", "parabolic", "modified-trapezoid")  # one of each kind
BY_NAME = {"ids": lambda value: value if isinstance(value, str) else type(value).__name__}


def cycle(name, far_dwell=0.0, near_dwell=0.0, stroke=STROKE, **shape):
    rod = {"rod_length": 2 * stroke} if name == "crank" else {}
    return Cycle(law(name, stroke, DURATION, **rod, **shape), far_dwell, near_dwell)


def made(name, follower, breadth=1.0, **options):
    return Cam(cycle(name, **options), breadth, follower)


def direction(angle):
    return np.array([np.cos(angle), np.sin(angle)])


# ---- Cams: circles and spirals in closed form, geometry by finite differences, published least breadths


BREADTH = 1.0
ALL_KINDS = [*((follower, name) for follower in FOLLOWERS for name in KINDS)]
ALL_KINDS += [pytest.param(FOLLOWERS[1], name, marks=pytest.mark.slow) for name in sorted(set(SMOOTH) - set(KINDS))]
AXIS, ARC = "the axis must lie inside the profile", "the profile must not run backwards"
TURN = np.linspace(0, 2 * np.pi, 97)


def inside_pieces(cam, count=240, margin=1e-3):
    """Angles at least a margin from any join."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.001234
    return angle[np.abs(angle[:, None] - np.array(cam.breakpoints)).min(axis=1) > margin]


# (a) closed forms


def test_harmonic_law_on_a_flat_face_is_an_eccentric_circle():
    cam = made("harmonic", FlatFace())
    x, y = cam.profile(TURN)
    assert np.hypot(x + STROKE / 2, y) == pytest.approx(BREADTH / 2, rel=1e-14)
    assert cam.curvature(TURN) == pytest.approx(2 / BREADTH, rel=1e-13)
    assert cam.least_radius_of_curvature == pytest.approx(BREADTH / 2, rel=1e-13)
    assert cam.largest_contact_offset == pytest.approx(STROKE / 2, rel=1e-13)


def test_harmonic_law_on_a_point_is_a_limacon():
    A, B = BREADTH / 2, -STROKE / 2
    exact = (A**2 + 2 * B**2 + 3 * A * B * np.cos(TURN)) / (A**2 + B**2 + 2 * A * B * np.cos(TURN)) ** 1.5
    cam = made("harmonic", Pointed())
    assert cam.curvature(TURN) == pytest.approx(exact, rel=1e-13)
    assert np.tan(cam.largest_pressure_angle) == pytest.approx(-B / np.sqrt(A**2 - B**2), rel=1e-13)


def test_constant_velocity_on_a_point_is_a_spiral_of_archimedes():
    cam, angle, k = made("constant-velocity", Pointed()), np.linspace(0.1, 3.0, 31), STROKE / np.pi
    rho = (BREADTH - STROKE) / 2 + k * angle
    assert cam.radius(angle) == pytest.approx(rho, rel=1e-14)
    assert cam.curvature(angle) == pytest.approx((rho**2 + 2 * k**2) / (rho**2 + k**2) ** 1.5, rel=1e-13)
    assert np.tan(cam.largest_pressure_angle) == pytest.approx(2 * k / (BREADTH - STROKE), rel=1e-12)


@pytest.mark.parametrize(("follower", "smaller"), [(Pointed(), 0), (RollerFollower(0.03), 0.03), (FlatFace(), 0)])
def test_dwells_are_arcs_about_the_axis(follower, smaller):
    cam = made("quintic", follower, far_dwell=1.0, near_dwell=2.0)
    for first, last, radius in ((3.05, 3.95, 0.7 - smaller), (7.05, 8.95, 0.3 - smaller)):
        angle = 2 * np.pi * np.linspace(first, last, 9) / 9
        assert np.hypot(*cam.profile(angle)) == pytest.approx(radius, rel=1e-14)
        assert cam.curvature(angle) == pytest.approx(1 / radius, rel=1e-14)
        assert np.all(cam.contact(angle).pressure_angle == 0)
        assert np.all(cam.contact(angle).offset == 0)


def test_breadth_error_of_a_crank_is_that_of_the_finite_rod():
    k = STROKE / 2 / (2 * STROKE)
    error = STROKE * (1 - np.sqrt(1 - k**2)) / k
    assert made("crank", Pointed()).breadth_error == pytest.approx(error, rel=1e-12)


# (c) published least breadths over the stroke, reference/errata.md "Cams"; the others need b > stroke

LEAST = dict.fromkeys(sorted(set(SMOOTH) - {"reversal-4-free-jerk", "reversal-4-free-both"}), (1.0, 1e-12, AXIS)) | {
    name: (ratio, 5e-4, ARC)
    for name, ratio in {
        "combined-3": 1.514, "combined-2": 1.736, "combined-4": 1.964, "reversal-3": 1.227, "reversal-4": 1.767,
        "reversal-3-free-acceleration": 1.084, "reversal-4-free-acceleration": 1.545,
    }.items()
}  # fmt: skip


@pytest.mark.parametrize("name", LEAST)
def test_published_least_breadth_of_a_flat_face(name):
    (ratio, within, rule), least = LEAST[name], least_breadth(cycle(name), FlatFace())
    assert least.breadth / STROKE == pytest.approx(ratio, abs=within)
    assert least.rule == rule


@pytest.mark.parametrize("follower", FOLLOWERS[1:], **BY_NAME)
@pytest.mark.parametrize("name", SHOCK)
def test_drop_of_velocity_is_impossible(name, follower):
    least, cam = least_breadth(cycle(name), follower), made(name, follower)
    assert (least.breadth, cam.undercut) == (np.inf, True)
    assert least.rule == "impossible: the velocity drops by 0.2667 m/s at the angle 3.142 rad"
    assert cam.least_radius_of_curvature == (-0.03 if follower != FlatFace() else -np.inf)


# geometry, from the profile alone


@pytest.mark.parametrize("name", [name for name in LAWS if name != "crank"])
@pytest.mark.parametrize("dwell", [0.0, 1.1])
def test_breadth_is_constant(name, dwell):
    cam = made(name, Pointed(), far_dwell=dwell, near_dwell=dwell)
    angle = np.linspace(-1, 7, 4001)
    assert cam.radius(angle) + cam.radius(angle + np.pi) == pytest.approx(BREADTH, rel=1e-14, abs=0)
    assert cam.breadth_error <= 1e-14 * BREADTH


@pytest.mark.parametrize("name", [*SMOOTH, "constant-velocity"])
@pytest.mark.parametrize("follower", FOLLOWERS, **BY_NAME)
def test_tangent_and_curvature_are_those_of_the_points(follower, name):
    cam, step = made(name, follower, breadth=1.5), 1e-5
    angle, travel = inside_pieces(cam), direction(inside_pieces(cam))
    before, after = (cam.profile(angle + shift) for shift in (-step, step))
    tx, ty = (after - before) / (2 * step)
    # the outward normal (ty, -tx) leans back by the pressure angle where the follower rises
    lean = np.arctan2(-(travel[0] * -tx - travel[1] * ty), travel[0] * ty - travel[1] * tx)
    assert cam.contact(angle).pressure_angle == pytest.approx(lean, abs=1e-7)
    before, here, after = (cam.profile(angle + shift) for shift in (-10 * step, 0, 10 * step))
    (dx, dy), (ddx, ddy) = (after - before) / (20 * step), (after - 2 * here + before) / (10 * step) ** 2
    exact = (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3
    assert cam.curvature(angle) == pytest.approx(exact, rel=2e-4, abs=2e-4)


@pytest.mark.parametrize(
    ("name", "dwell"),
    [
        *((name, 0.0) for name in SMOOTH),
        *(pytest.param(name, dwell, marks=pytest.mark.slow) for dwell in (6.0, 30.0) for name in SMOOTH),
    ],
)
def test_roller_touches_its_cam_without_overlap(name, dwell):
    """Envelope: of all points of the profile the nearest to each roller centre is r away."""
    r = 0.03
    cam = made(name, RollerFollower(r), near_dwell=dwell)
    cam = replace(cam, breadth=1.01 * cam.least_breadth().breadth)
    angle = np.concatenate([np.linspace(0, 4 * np.pi * DURATION / cam.cycle.period, 1500), [5.0, 6.0]])
    centres, profile = cam.radius(angle) * direction(angle), cam.profile(angle)
    assert not cam.undercut
    assert np.hypot(*(centres - profile)) == pytest.approx(r, rel=1e-12)
    assert np.hypot(*(profile[:, None] - centres[:, :, None])).min(axis=1) == pytest.approx(r, rel=1e-9)


@pytest.mark.parametrize("name", ["septic", "reversal-4", "combined-2"])
def test_flat_face_touches_its_cam_without_overlap(name):
    cam, angle = made(name, FlatFace()), np.linspace(0, 2 * np.pi, 1001)
    reach = direction(angle).T @ cam.profile(angle)
    assert reach.max(axis=1) == pytest.approx(cam.radius(angle), rel=1e-13)
    assert np.abs(cam.contact(angle).offset).max() == pytest.approx(cam.largest_contact_offset, rel=1e-4)


@pytest.mark.sampled(6)
@pytest.mark.parametrize(("follower", "name"), ALL_KINDS, **BY_NAME)
def test_extremes_are_those_of_dense_samples(follower, name):
    cam, angle = made(name, follower, far_dwell=0.3), np.linspace(0, 2 * np.pi, 100_001)
    pressure = np.abs(cam.contact(angle).pressure_angle).max()
    assert cam.largest_pressure_angle == pytest.approx(pressure, rel=3e-5, abs=1e-15)
    assert cam.largest_pressure_angle >= pressure * (1 - 1e-12)
    radius = 1 / cam.curvature(angle)
    least = (radius if follower == FlatFace() else radius[cam.curvature(angle) > 0]).min()
    assert cam.least_radius_of_curvature == pytest.approx(least, abs=1e-4)
    assert cam.least_radius_of_curvature <= least + 1e-12


# joins


def test_velocity_jumps_are_corners_of_the_pitch_curve():
    assert made("constant-velocity", Pointed()).corner_angles == pytest.approx((0, np.pi), abs=1e-15)
    standing = made("constant-velocity", Pointed(), far_dwell=1.0, near_dwell=2.0)
    assert standing.corner_angles == pytest.approx([2 * np.pi * time / 9 for time in (0, 3, 4, 7)], abs=1e-14)
    assert (standing.undercut, standing.least_radius_of_curvature) == (False, 0)
    assert {made(name, Pointed()).corner_angles for name in SMOOTH} == {()}


def test_jump_of_acceleration_is_a_jump_of_curvature():
    cam, join = made("parabolic", Pointed()), np.pi / 2
    before, after = cam.curvature(np.array([join - 1e-9, join + 1e-9]))
    rho, jump, w = BREADTH / 2, 8 * STROKE / np.pi**2, np.hypot(BREADTH / 2, 2 * STROKE / np.pi)
    assert after - before == pytest.approx(rho * jump / w**3, rel=1e-6)
    assert cam.curvature(join) == pytest.approx(after, rel=1e-6)


def test_upward_jump_of_velocity_is_a_straight_part_of_the_cam():
    up = replace(law("combined-2", STROKE, DURATION, run_up=0.0, run_down=0.3), retraces=True)
    least = least_breadth(Cycle(up), FlatFace())
    assert np.isfinite([least.breadth, least_breadth(Cycle(up), FOLLOWERS[1]).breadth]).all()
    assert not Cam(Cycle(up), 1.01 * least.breadth, FlatFace()).undercut
    assert least_breadth(Cycle(replace(up, retraces=False)), FlatFace()).breadth == np.inf


# (e) properties

shapes = st.fixed_dictionaries(
    {"name": st.sampled_from(SMOOTH)}
    | dict.fromkeys(("run_up", "run_down"), st.floats(0.02, 0.5))
    | dict.fromkeys(("far_dwell", "near_dwell"), st.sampled_from([0.0, 0.4, 3.0]))
)
followers = st.one_of(st.just(Pointed()), st.just(FlatFace()), st.floats(1e-3, 3.0).map(RollerFollower))


@examples(8, slow=40)
@given(shapes, followers)
def test_profile_above_the_least_breadth_does_not_run_backwards(shape, follower):
    motion, angle = cycle(**shape), np.linspace(0, 2 * np.pi, 20_001)
    least = least_breadth(motion, follower)
    cam = Cam(motion, least.breadth * (1 + 1e-6), follower)
    assert not cam.undercut
    assert cam.contact(angle).arc.min() > 0
    assert cam.radius(angle).min() > follower.radius
    if least.rule == ARC:
        narrow = Cam(motion, least.breadth * (1 - 1e-6), follower)
        assert narrow.undercut
        assert narrow.least_radius_of_curvature < 0


# ---- Machining: followers on the exported points keep the law, the cutter fits, drawing and DXF are true to scale


NARROW, MICROMETRE = 0.9, 1e-6
narrow = partial(made, breadth=NARROW)
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
    one = cut(narrow("harmonic", FlatFace()), cutter_radius=0.025)
    centre = np.array([-STROKE / 2, 0.0])
    assert np.hypot(*(one.profile - centre).T) == pytest.approx(NARROW / 2, abs=1e-9)
    assert np.hypot(*(one.cutter_path - centre).T) == pytest.approx(NARROW / 2 + 0.025, abs=1e-9)


def test_hollow_of_a_limacon():
    """rho = A - B cos(phi) is hollow at 0 for A < 2 B; its radius of curvature there is (A - B)^2/(2 B - A)."""
    cam = narrow("harmonic", Pointed(), breadth=0.6)
    assert cam.least_hollow_radius == pytest.approx(0.1, rel=1e-9)
    assert largest_cutter(cam) == pytest.approx(0.1, rel=1e-9)


def test_cutter_of_the_roller_radius_moves_along_the_pitch_curve():
    cam = narrow("reversal-4", RollerFollower(0.03))
    one = cut(cam, cutter_radius=0.03)
    assert one.cutter_path == pytest.approx((cam.radius(one.angle) * direction(one.angle)).T, abs=1e-9)


# (b) order


@pytest.mark.sampled(1)
@pytest.mark.parametrize("follower", FOLLOWERS, **BY_NAME)
def test_number_of_points_grows_as_the_root_of_the_tolerance(follower):
    cam, tolerances = narrow("reversal-3", follower), np.array([1e-5, 1e-6, 1e-7])
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
    cam = narrow(law, follower, **options)
    one = cut(cam)
    assert off_the_law(one.profile, cam) <= MICROMETRE
    assert one.error <= MICROMETRE
    assert len(one.angle) < (2500 if not options else 20_000)


# (d) hard cases


@pytest.mark.parametrize("follower", FOLLOWERS[1:], **BY_NAME)
def test_cam_just_above_its_least_breadth_can_be_machined(follower):
    cam = narrow("reversal-4", follower)
    cam = Cam(cam.cycle, 1.001 * cam.least_breadth().breadth, follower)
    assert off_the_law(cut(cam).profile, cam) <= MICROMETRE


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["combined-2", "reversal-3", "harmonic"])
def test_largest_cutter_touches_the_profile_and_removes_nothing(name):
    cam = narrow(name, RollerFollower(0.05), breadth=0.55 + 0.05)
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
    cam = narrow("reversal-3", RollerFollower(0.03))
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
            lambda: cut(narrow("reversal-4", FlatFace(), breadth=0.6)),
            r"undercut: its breadth must exceed 0\.70\d+ m \(the profile",
        ),
        (
            lambda: cut(narrow("constant-velocity", Pointed())),
            "corner where the velocity of the law jumps, at the angle 0",
        ),
        (
            lambda: cut(narrow("harmonic", Pointed(), breadth=0.6), cutter_radius=0.2),
            r"`cutter_radius` must be at most 0\.09999999 m to fit .* got 0\.2 m; use a smaller cutter",
        ),
        (
            lambda: workshop_drawing.workshop_drawing(cut(narrow("harmonic", FlatFace())), bore=0.5),
            r"`bore` must be positive and below 0\.5 m, the smallest diameter",
        ),
        (lambda: follower_on_polygon(SQUARE, FlatFace(), np.array([np.nan])), r"`angle` must be finite, got \[nan\]"),
    ],
)
def test_cams_and_cutters_that_do_not_fit_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
