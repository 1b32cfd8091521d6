# SPDX-License-Identifier: Apache-2.0
"""A picture shows the chain at its coordinates and the velocities of its masses."""

import math
from typing import Any

import numpy as np
import pytest
from chains import EPS, EXAMPLES, SPINNER, any_angles, any_chain, any_configuration, chain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import wall_between
from matplotlib.figure import Figure

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.drawing import (
    ChainPicture,
    class_and_shape,
    description,
    draw_torus,
    expand_limits,
    limits,
    mass_points,
    mode_arrows,
    parameters,
    projection_quiver,
    shape,
    split_at_wraps,
)
from soliton_linkage_studies.unit_cell import configuration_curves

FEW = settings(max_examples=15)


def new_axes() -> Any:
    return Figure().subplots()


def ends(segments: Any) -> tuple[Array, Array]:
    """Return the first and last points of line segments, each (K, 2)."""
    points = np.array([np.asarray(segment) for segment in segments.get_segments()])
    return points[:, 0], points[:, 1]


def arrow_vectors(quiver: Any) -> Array:
    return np.column_stack([quiver.U, quiver.V])


def reach(chain: Chain) -> float:
    """Return the length to which rounding errors of coordinates are relative [m]."""
    return float(chain.spacing * chain.number_of_rotors + chain.rotor_length)


@FEW
@given(any_configuration())
def test_masses_are_at_the_ends_of_rotors_on_evenly_spaced_pivots(configuration):
    chain, angles = configuration
    picture = ChainPicture(new_axes(), chain, angles)
    limit = 8 * EPS * reach(chain)
    for n, (x, z) in enumerate(picture.masses.get_xydata()):
        assert x == pytest.approx(
            n * chain.spacing + chain.rotor_length * math.sin(angles[n]), rel=0, abs=limit
        )
        assert z == pytest.approx(chain.rotor_length * math.cos(angles[n]), rel=0, abs=limit)
    pivots, masses = ends(picture.rotors)
    assert np.array_equal(masses, picture.masses.get_xydata())
    assert np.array_equal(pivots, picture.pivots.get_xydata())


@FEW
@given(any_configuration())
def test_springs_are_drawn_from_mass_to_mass_with_their_length(configuration):
    chain, angles = configuration
    first, last = ends(ChainPicture(new_axes(), chain, angles).springs)
    lengths = np.hypot(*(last - first).T)
    expected = chain.rest_lengths + chain.spring_extensions(angles)
    # The error of a length near 0 is the square root of the rounding error.
    limit = 16 * EPS * reach(chain) + 4 * EPS * reach(chain) ** 2 / chain.rest_length
    assert lengths == pytest.approx(expected, rel=0, abs=4 * limit)


def test_a_ring_has_a_spring_beyond_its_last_rotor():
    chain = Chain(6, 0.1, 0.05, 0.97, periodic=True)
    angles = chain.uniform_state(1)
    first, last = ends(ChainPicture(new_axes(), chain, angles).springs)
    assert len(first) == 6
    lengths = np.hypot(*(last - first).T)
    assert lengths == pytest.approx(chain.rest_length, rel=8 * EPS)


@given(any_configuration(), st.data())
def test_arrows_have_the_direction_of_the_mass_velocities(configuration, data):
    chain, angles = configuration
    mode = data.draw(any_angles(chain))
    step = 1e-5
    way = mass_points(chain, angles + step * mode) - mass_points(chain, angles - step * mode)
    limit = chain.rotor_length * (step**2 * 9**3 / 6) + 4 * EPS * reach(chain) / step
    assert way / (2 * step) == pytest.approx(mode_arrows(chain, angles, mode), rel=0, abs=limit)


@FEW
@given(any_chain(fewest=2), st.sampled_from([-1, 1]), st.floats(0.1, 3))
def test_drawn_arrows_have_one_scale_for_all_rotors(chain, lean, arrow_length):
    angles = chain.uniform_state(lean)
    mode = zero_mode(chain, angles)
    picture = ChainPicture(new_axes(), chain, angles, mode, arrow_length=arrow_length)
    assert picture.arrows is not None
    assert np.hypot(*arrow_vectors(picture.arrows).T) == pytest.approx(
        arrow_length * np.abs(mode), rel=16 * EPS
    )
    assert np.array_equal(picture.arrows.get_offsets(), np.transpose(picture.masses.get_data()))


def test_an_updated_picture_equals_a_new_picture():
    for example in EXAMPLES:
        chain = chain_of(example, 12)
        rest, wall = chain.uniform_state(1), wall_between(chain, 5)
        mode = zero_mode(chain, wall)
        moved = ChainPicture(new_axes(), chain, rest, zero_mode(chain, rest), projections=True)
        moved.update(wall, mode)
        fresh = ChainPicture(new_axes(), chain, wall, mode, projections=True)
        for one, other in ((moved.rotors, fresh.rotors), (moved.springs, fresh.springs)):
            assert np.array_equal(ends(one), ends(other))
        for one, other in ((moved.arrows, fresh.arrows), (moved.projections, fresh.projections)):
            assert one is not None
            assert other is not None
            assert np.array_equal(arrow_vectors(one), arrow_vectors(other))
            assert np.array_equal(one.get_offsets(), other.get_offsets())
            assert np.array_equal(one.get_array(), other.get_array())


@FEW
@given(any_configuration(), st.floats(-1.5, 1.5))
def test_a_tilt_turns_the_chain_about_its_middle_and_lowers_the_last_rotor(configuration, tilt):
    chain, angles = configuration
    picture = ChainPicture(new_axes(), chain, angles, angles)
    flat = np.concatenate([picture.masses.get_xydata(), picture.pivots.get_xydata()])
    arrows = arrow_vectors(picture.arrows)
    picture.update(angles, angles, tilt)
    tilted = np.concatenate([picture.masses.get_xydata(), picture.pivots.get_xydata()])
    middle = np.array([(chain.number_of_rotors - 1) * chain.spacing / 2, 0])
    turned = complex(math.cos(tilt), -math.sin(tilt))
    limit = 16 * EPS * reach(chain)
    for before, after in zip(flat - middle, tilted - middle, strict=True):
        assert complex(*after) == pytest.approx(complex(*before) * turned, rel=0, abs=limit)
    for before, after in zip(arrows, arrow_vectors(picture.arrows), strict=True):
        scale = 16 * EPS * (1 + abs(complex(*before)))
        assert complex(*after) == pytest.approx(complex(*before) * turned, rel=0, abs=scale)


@FEW
@given(any_configuration(), st.booleans())
def test_the_limits_contain_the_chain_with_equal_scales(configuration, projections):
    chain, angles = configuration
    axes = new_axes()
    picture = ChainPicture(axes, chain, angles, projections=projections)
    left, right, bottom, top = limits(chain, projections)
    assert (axes.get_xlim(), axes.get_ylim()) == ((left, right), (bottom, top))
    assert axes.get_aspect() == 1
    points = picture.masses.get_xydata()
    if picture.projections is not None:
        starts = np.asarray(picture.projections.get_offsets())
        points = np.concatenate([points, starts, starts + arrow_vectors(picture.projections)])
    assert (points > (left, bottom)).all()
    assert (points < (right, top)).all()


@FEW
@given(any_configuration(), any_configuration())
def test_expanded_limits_contain_every_arrow_and_are_equal_in_all_pictures(one, other):
    pictures = [
        ChainPicture(new_axes(), chain, angles, zero_mode(chain, angles))
        for chain, angles in (one, other)
    ]
    before = [limits(picture.chain) for picture in pictures]
    width, height = expand_limits(pictures)
    for picture, (left, right, bottom, top) in zip(pictures, before, strict=True):
        low, high = np.transpose([picture.axes.get_xlim(), picture.axes.get_ylim()])
        assert (low <= (left, bottom)).all()
        assert (high >= (right, top)).all()
        assert high - low == pytest.approx((width, height), rel=1e-12)
        tips = np.asarray(picture.arrows.get_offsets()) + arrow_vectors(picture.arrows)
        assert (tips > low).all()
        assert (tips < high).all()


@FEW
@given(any_configuration())
def test_projections_are_the_displacements_below_their_pivots(configuration):
    chain, angles = configuration
    quiver = projection_quiver(new_axes(), chain, angles)
    vectors, positions = arrow_vectors(quiver), np.asarray(quiver.get_offsets())
    limit = 8 * EPS * reach(chain)
    leans = [chain.rotor_length * math.sin(angle) for angle in angles]
    assert vectors[:, 0] == pytest.approx(leans, rel=0, abs=limit)
    assert not vectors[:, 1].any()
    pivots = chain.spacing * np.arange(chain.number_of_rotors)
    assert positions[:, 0] == pytest.approx(pivots, rel=0, abs=limit)
    assert (positions[:, 1] < -chain.rotor_length).all()


@given(st.floats(-20, 20), st.floats(-3, 3), st.floats(-3, 3))
def test_a_curve_on_the_torus_is_broken_where_it_leaves_the_square(start, across, up):
    steps = np.linspace(0, 5, 60)
    curve = np.column_stack([start + across * steps, up * steps])
    broken = split_at_wraps(curve)
    kept = broken[~np.isnan(broken[:, 0])]
    assert (np.abs(kept) <= np.pi).all()
    turns = (kept - curve) / (2 * np.pi)
    assert turns == pytest.approx(np.round(turns), rel=0, abs=64 * EPS)
    leaps = np.abs(np.diff(broken, axis=0)).max(axis=1)
    assert (leaps[~np.isnan(leaps)] < 1).all()


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_ground_states_on_the_torus_lean_as_labelled_and_lie_on_the_curves(example):
    chain = chain_of(example, 2)
    curves = configuration_curves(chain, 2000)
    axes = new_axes()
    draw_torus(axes, chain, curves)
    marked = {line.get_label(): line.get_xydata() for line in axes.lines[len(curves) :]}
    assert (np.sin(marked['leans right']) > 0).all()
    assert (np.sin(marked['leans left']) < 0).all()
    points = np.concatenate([line.get_xydata() for line in axes.lines[: len(curves)]])
    spacing = max(np.hypot(*np.diff(curve, axis=0).T).max() for curve in curves)
    for state in np.concatenate(list(marked.values())):
        assert np.nanmin(np.hypot(*(points - state).T)) < spacing


def test_a_caption_names_class_and_parameters():
    chain = chain_of(SPINNER, 20)
    assert class_and_shape(chain) == 'spinner (2, 1.18)'
    assert parameters(chain) == 'r/a = 2, θ̄ = 1.18'
    assert shape(chain) == 'r/a = 2, θ̄ = 1.18, d = 3.70'
    said = 'spinner: r/a = 2, rest angle 1.18 rad, d = 3.70, 20 rotors'
    assert description(chain) == said
