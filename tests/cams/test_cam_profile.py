"""Cams: circles and spirals in closed form, geometry by finite differences, published least breadths."""

from dataclasses import replace

import numpy as np
import pytest
from cam_samples import BY_NAME, DURATION, FOLLOWERS, KINDS, SHOCK, SMOOTH, STROKE, cycle, direction, made
from hypothesis import given
from hypothesis import strategies as st
from sampling import examples

from compact.cams.profile import Cam, FlatFace, Pointed, RollerFollower, least_breadth
from compact.motion.profile import LAWS, Cycle, law

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


# (d) hard cases


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


# (g) refusals
