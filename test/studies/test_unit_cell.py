# SPDX-License-Identifier: Apache-2.0
"""The bar of a unit cell keeps its length along closed curves, whose number changes at d_c."""

import math
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from chains import (
    EPS,
    EXAMPLES,
    FLIPPER,
    SPINNER,
    STRONG_WOBBLER,
    WIDE_SPINNER,
    WOBBLER,
    any_chain,
    chain_of,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from linkage_motion import distance

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import length_rounding
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage_studies.unit_cell import (
    component_of,
    configuration_curves,
    flipper_limit,
    ground_states,
    partner_angles,
    spinner_limit,
    windings,
)

ANGLES = st.floats(-9, 9)
RATIOS = st.floats(0.02, 20)
REST_ANGLES = st.floats(0.01, 1.56)
# Largest distance of two curves through the same configurations [rad]: the tolerance 1e-12 of the
# arc length integration, over a few hundred steps.
TRACED = 1e-9


@st.composite
def near_transition(draw: st.DrawFn) -> tuple[Chain, Chain]:
    """Draw a flipper and a spinner within 10^-1 to 10^-11 of d_c, r / a from 1 to 20."""
    rest_angle = draw(st.floats(0.23, 1.56))
    limit = 1 / math.sin(rest_angle) ** 2
    share = 10 ** draw(st.floats(-11, -1))
    return chain_of((limit * (1 - share), rest_angle), 2), chain_of(
        (limit * (1 + share), rest_angle), 2
    )


def extensions(chain: Chain, configurations: Array) -> Array:
    """Return the extension of the bar in staggered configurations [m], (..., 2) to (...)."""
    return chain.spring_extensions(staggered(configurations))[..., 0]


def reference_partners(chain: Chain, theta_1: float) -> tuple[mpmath.mpf, list[mpmath.mpf]]:
    """Return the radicand [m^2] and the solutions with forty digits."""
    r, a, angle, rest = map(
        mpmath.mpf, (chain.rotor_length, chain.spacing, theta_1, chain.rest_angle)
    )
    p, q = r * mpmath.cos(angle), a - r * mpmath.sin(angle)
    g = r * mpmath.cos(2 * rest) + a * mpmath.sin(angle)
    square = p**2 + q**2 - g**2
    if square < 0:
        return square, []
    towards, away = mpmath.atan2(q, p), mpmath.acos(g / mpmath.sqrt(p**2 + q**2))
    return square, [towards - away, towards + away]


@given(any_chain(2, 2), ANGLES)
def test_the_partners_agree_with_forty_digit_solutions(chain, angle):
    with mpmath.workdps(40):
        square, expected = reference_partners(chain, angle)
        # A length error changes the second angle by this error over the root of the radicand.
        reach = chain.spacing + 2 * chain.rotor_length
        root = float(mpmath.sqrt(abs(square)))
        assume(root > 1e-6 * reach)
        found = partner_angles(chain, angle)
        if not expected:
            assert np.isnan(found).all()
            return
        for partner, reference in zip(found, expected, strict=True):
            error = float(mpmath.mpf(float(partner)) - reference)
            assert abs(math.remainder(error, 2 * math.pi)) <= 16 * EPS * (1 + reach / root)


@settings(max_examples=10)
@given(any_chain(2, 2))
def test_curves_close_and_keep_the_bar(chain):
    curves = configuration_curves(chain, 100)
    spinner = chain.motion is Motion.SPINNER
    assert len(curves) == (2 if spinner else 1)
    for curve in curves:
        assert curve.shape == (101, 2)
        assert (np.abs(extensions(chain, curve)) <= length_rounding(chain)).all()
        assert windings(curve) == ((1, -1) if spinner else (0, 0))
        assert np.linalg.norm(np.diff(curve, axis=0), axis=1).max() < 0.5


@settings(max_examples=8)
@given(near_transition())
def test_one_curve_splits_into_two_at_d_c_and_no_step_crosses_the_gap(pair):
    flipper, spinner = pair
    (whole,) = configuration_curves(flipper, 800)
    halves = configuration_curves(spinner, 400)
    assert windings(whole) == (0, 0)
    assert [windings(half) for half in halves] == [(1, -1), (1, -1)]
    for chain, curves in ((flipper, (whole,)), (spinner, halves)):
        for curve in curves:
            assert (np.abs(extensions(chain, curve)) <= length_rounding(chain)).all()
    for index, half in enumerate(halves):
        assert (component_of(spinner, half) == index).all()


def on_a_curve(chain: Chain, configurations: Array) -> Array:
    """Return the distance of configurations from their curve, in steps of the curve."""
    curves = configuration_curves(chain, 400)
    components = component_of(chain, configurations)
    nearest = []
    for configuration, component in zip(configurations, components, strict=True):
        curve = curves[component]
        step = np.linalg.norm(np.diff(curve, axis=0), axis=1).max()
        nearest.append(float(distance(curve, configuration).min()) / step)
    return np.array(nearest)


@settings(max_examples=10)
@given(any_chain(2, 2))
def test_the_curves_pass_through_the_ground_states(chain):
    states = ground_states(chain)
    assert (np.abs(extensions(chain, states)) <= length_rounding(chain)).all()
    assert (on_a_curve(chain, states) <= 0.5 + 1e-6).all()


@settings(max_examples=10)
@given(any_chain(2, 2), st.integers(0, 99), st.integers(-2, 2))
def test_mirror_images_lie_on_the_curves(chain, position, turns):
    curves = configuration_curves(chain, 100)
    spinner = len(curves) == 2
    first, second = curves[0][position]
    mirrored = np.array([[-second, -first], [second - np.pi, first + np.pi]])
    turned = mirrored + 2 * np.pi * np.array([turns, -turns])
    # Angles up to 22 rad are rounded twice, and each angle moves an end of the bar by up to r.
    limit = length_rounding(chain) + 64 * EPS * chain.rotor_length
    assert (np.abs(extensions(chain, turned)) <= limit).all()
    assert component_of(chain, turned).tolist() == ([1, 0] if spinner else [0, 0])
    assert (on_a_curve(chain, turned) <= 0.5 + 1e-6).all()


def test_a_component_of_a_spinner_holds_one_pair_of_ground_states():
    for example in [SPINNER, WIDE_SPINNER]:
        chain = chain_of(example, 2)
        states = ground_states(chain)
        rest = chain.rest_angle
        assert states[:, 0].tolist() == [rest, -rest, math.pi - rest, math.pi + rest]
        assert component_of(chain, states).tolist() == [0, 1, 1, 0]
        for index, curve in enumerate(configuration_curves(chain)):
            near = [distance(curve, state).min() < 0.02 for state in states]
            assert near == [component == index for component in (0, 1, 1, 0)]


def test_the_curve_of_a_flipper_visits_all_ground_states_in_order():
    for example in [FLIPPER, WOBBLER, STRONG_WOBBLER]:
        chain = chain_of(example, 2)
        (curve,) = configuration_curves(chain)
        positions = [int(np.argmin(distance(curve, state))) for state in ground_states(chain)]
        right, left, left_hanging, right_hanging = positions
        assert right < right_hanging < left_hanging < left
        assert component_of(chain, ground_states(chain)).tolist() == [0, 0, 0, 0]


@lru_cache
def perimeter(chain: Chain) -> float:
    """Return the length of a component [rad] from its chords by Richardson extrapolation."""
    lengths = [
        float(
            np.linalg.norm(np.diff(configuration_curves(chain, points)[0], axis=0), axis=1).sum()
        )
        for points in (6400, 12800)
    ]
    return (4 * lengths[1] - lengths[0]) / 3


@pytest.mark.parametrize(
    ('example', 'sense'), [*((example, 1) for example in EXAMPLES), (FLIPPER, -1), (SPINNER, -1)]
)
def test_two_rotors_on_a_rigid_bar_run_along_the_curve(example, sense):
    # Both rotors have the same inertia, so without forces the speed along the curve is constant.
    chain = chain_of(example, 2)
    for curve in configuration_curves(chain, 200):
        angles = staggered(curve[::sense])
        mode = zero_mode(chain, angles[0])
        forwards = math.copysign(1.0, float(mode @ (angles[1] - angles[0])))
        rates = forwards * perimeter(chain) / 200 * mode
        recording = RigidSimulation(chain, angles[0], rates, period=1.0).record(200.0)
        assert np.abs(recording.angles - angles).max() < 10 * TRACED


@given(REST_ANGLES, st.floats(1e-14, 0.5), st.sampled_from([-1, 1]))
def test_the_limits_separate_the_classes(rest_angle, share, side):
    factor = 1 + side * share
    first, second = flipper_limit(rest_angle), spinner_limit(rest_angle)
    assert first < second
    wobbling, spinning = (
        Chain(2, 0.01, 0.01 * limit * factor, rest_angle).motion for limit in (first, second)
    )
    assert (wobbling is not Motion.FLIPPER) == (spinning is Motion.SPINNER) == (side > 0)
    assert wobbling is not Motion.SPINNER


def test_at_d_c_itself_a_curve_is_still_closed():
    chain = Chain(2, spacing=0.1, rotor_length=0.2, rest_angle=math.asin(math.sqrt(0.5)))
    assert chain.lean_ratio == pytest.approx(chain.critical_lean_ratio, rel=4 * EPS)
    for curve in configuration_curves(chain):
        assert np.isfinite(curve).all()
        assert (np.abs(extensions(chain, curve)) <= length_rounding(chain)).all()
        windings(curve)


def test_a_curve_that_does_not_close_is_rejected():
    with pytest.raises(ValueError, match=r'differ by 0\.159155 and 0 turns'):
        windings([[0, 0], [1, 0]])
