# SPDX-License-Identifier: Apache-2.0
"""Laws of the continuum theories: stationary action, and energies as integrals of densities."""

import dataclasses
import math

import mpmath
import numpy as np
import pytest
from chains import EPS, FLIPPER, SPINNER, any_chain, chain_of
from continuum_theories import Theory, theory_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.continuum import FlipperTheory, SpinnerTheory

SIGNS = st.sampled_from([-1, 1])
FRACTIONS = st.floats(-0.99, 0.99)
# Five-point differences over a thousandth of a width: to the fourth order of it, and EPS over it.
DIFFERENCE = 1e-3
DIFFERENTIATED = 1e-10


@st.composite
def any_theory(draw: st.DrawFn, exact_sound: bool = False) -> Theory:
    chain = draw(any_chain(fewest=3))
    assume(abs(chain.lean_ratio - 1) > 1e-3)
    assume(abs(chain.lean_ratio / chain.critical_lean_ratio - 1) > 1e-6)
    return theory_of(chain, exact_sound)


@st.composite
def any_spinner(draw: st.DrawFn) -> SpinnerTheory:
    """Draw a theory of any spinner with r / a up to 20."""
    rest_angle = draw(st.floats(0.23, 1.56))
    fraction = draw(st.floats(1e-6, 1))
    least = 1 / math.sin(rest_angle) ** 2
    chain = chain_of((least + fraction * (20 - least), rest_angle), 3)
    return SpinnerTheory(chain, family=draw(SIGNS))


def field(theory: Theory, positions: Array, velocity: float, charge: int) -> Array:
    if isinstance(theory, FlipperTheory):
        return theory.displacements(positions, 0.0, velocity, charge)
    return theory.rotation(positions, 0.0, velocity, charge)


def scale_of(theory: Theory) -> float:
    return theory.lean if isinstance(theory, FlipperTheory) else 1.0


def slope(theory: Theory, positions: Array, velocity: float, charge: int) -> Array:
    step = DIFFERENCE * theory.width(velocity)
    values = [field(theory, positions + n * step, velocity, charge) for n in (-2, -1, 1, 2)]
    return np.asarray((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step))


@given(any_theory(), SIGNS)
def test_a_wall_at_rest_solves_the_equation_of_first_order(theory, charge):
    width = theory.width()
    positions = width * np.linspace(-6, 6, 41)
    values = field(theory, positions, 0.0, charge)
    limit = DIFFERENTIATED * scale_of(theory) / width
    expected = charge * theory.static_slope(values)
    assert slope(theory, positions, 0.0, charge) == pytest.approx(expected, rel=0, abs=limit)


@given(any_theory(), FRACTIONS, SIGNS, st.floats(-3, 3), st.floats(0.3, 2))
def test_a_boosted_wall_makes_the_action_stationary(theory, fraction, charge, centre, breadth):
    velocity = fraction * theory.speed_of_sound
    width = theory.width(velocity)
    x = np.linspace(-20, 20, 4001)
    values = field(theory, x * width, velocity, charge)
    slopes = slope(theory, x * width, velocity, charge)
    bump = scale_of(theory) * np.exp(-(((x - centre) / breadth) ** 2))
    bump_slopes = -2 * (x - centre) / breadth**2 * bump / width

    def terms(fraction: float) -> tuple[float, float]:
        moved, steeper = values + fraction * bump, slopes + fraction * bump_slopes
        kinetic = theory.kinetic_density(-velocity * steeper)
        elastic = theory.elastic_density(moved, steeper)
        return float(kinetic.sum()), float(elastic.sum())

    step = 1e-4
    (more_kinetic, more_elastic), (less_kinetic, less_elastic) = terms(step), terms(-step)
    change = (more_kinetic - more_elastic) - (less_kinetic - less_elastic)
    # The terms of the third order in the step are left, and what their sizes are rounded to.
    size = sum(abs(term) for term in (*terms(step), *terms(1.0)))
    assert abs(change) / (2 * step) <= 1e-6 * size


@settings(max_examples=25)
@given(any_theory(), FRACTIONS, SIGNS)
def test_energies_are_the_integrals_of_their_densities(theory, fraction, charge):
    velocity = fraction * theory.speed_of_sound
    width = theory.width(velocity)

    def kinetic(x: float) -> float:
        slopes = slope(theory, np.array(x * width), velocity, charge)
        return float(theory.kinetic_density(velocity * slopes)) * width

    def elastic(x: float) -> float:
        position = np.array(x * width)
        slopes = slope(theory, position, velocity, charge)
        values = field(theory, position, velocity, charge)
        return float(theory.elastic_density(values, slopes)) * width

    limit = 1e-8 * theory.energy_scale
    in_motion = quad(kinetic, -20, 20, epsabs=limit / 10, limit=200)[0]
    in_springs = quad(elastic, -20, 20, epsabs=limit / 10, limit=200)[0]
    assert theory.kinetic_energy(velocity) == pytest.approx(in_motion, rel=1e-8, abs=limit)
    assert theory.elastic_energy(velocity, charge) == pytest.approx(
        in_springs, rel=1e-8, abs=limit
    )
    assert theory.energy(velocity, charge) == pytest.approx(
        in_motion + in_springs, rel=1e-8, abs=limit
    )


@given(any_theory(), st.floats(-12, -1e-4), SIGNS)
def test_energies_at_any_speed_agree_with_thirty_digits(theory, exponent, charge):
    velocity = theory.speed_of_sound * 10**exponent
    with mpmath.workdps(30):
        ratio = mpmath.mpf(velocity) / mpmath.mpf(theory.speed_of_sound)
        gamma = 1 / mpmath.sqrt(1 - ratio**2)
        scale = mpmath.mpf(theory.energy_scale)
        whole = (gamma - charge) * scale
        springs = (gamma - charge) ** 2 / (2 * gamma) * scale
        width = float(mpmath.mpf(theory.chain.wall_width) / gamma)
    rel = 64 * EPS / (1 - float(ratio))
    assert theory.energy(velocity, charge) == pytest.approx(float(whole), rel=rel)
    assert theory.elastic_energy(velocity, charge) == pytest.approx(float(springs), rel=rel)
    assert theory.width(velocity) == pytest.approx(width, rel=rel)
    assert theory.lorentz_factor(-velocity) == theory.lorentz_factor(velocity)
    in_springs, in_motion = theory.elastic_energy(velocity), theory.kinetic_energy(velocity)
    assert in_springs + in_motion == pytest.approx(theory.energy(velocity), rel=1e-12)
    assert theory.energy(0.0) == 0
    assert theory.energy(0.0, -1) == 2 * theory.energy_scale


@given(any_theory())
def test_the_exact_speed_of_sound_is_that_of_the_chain(theory):
    chain = theory.chain
    d = chain.lean_ratio
    exact = dataclasses.replace(theory, exact_sound=True).speed_of_sound
    assert exact == pytest.approx(speed_of_sound(chain), rel=1e-9)
    fraction = math.sqrt(abs((1 - d) * (1 + d)))
    fraction = (
        fraction / d
        if isinstance(theory, SpinnerTheory)
        else fraction * math.cos(chain.rest_angle)
    )
    assert exact == pytest.approx(theory.limiting_speed_of_sound * fraction, rel=1e-9)
    assert theory.speed_of_sound == theory.limiting_speed_of_sound


@given(any_theory(exact_sound=True), st.floats(-8, 2), st.floats(0.1, 10), SIGNS)
def test_a_kick_has_the_energy_of_the_wall(theory, exponent, factor, sense):
    kick = sense * 10**exponent * theory.arc_per_site * theory.speed_of_sound
    speed = theory.speed_after_kick(kick)
    assert abs(speed) < theory.speed_of_sound
    assert math.copysign(1, speed) == sense
    rel = 1e-12 * (1 + 10 ** (4 * exponent))
    assert theory.energy(speed) == pytest.approx(theory.chain.mass * kick**2 / 2, rel=rel)
    assert theory.speed_after_kick(factor * kick, factor * theory.arc_per_site) == pytest.approx(
        speed, rel=1e-12
    )
    with mpmath.workdps(30):
        gained = (mpmath.mpf(kick) / (theory.arc_per_site * theory.speed_of_sound)) ** 2 / 2
        expected = theory.speed_of_sound * mpmath.sqrt(1 - 1 / (1 + gained) ** 2)
    assert abs(speed) == pytest.approx(float(expected), rel=64 * EPS)
    assert theory.speed_after_kick(0.0) == 0
    assert theory.speed_after_kick(-1e200) == -theory.speed_of_sound


def test_walls_at_rest_have_a_theory_at_zero_speed_of_sound():
    # A lean ratio of 1 to the last digit.
    chain = Chain(3, spacing=1.0, rotor_length=1.0, rest_angle=math.asin(0.5))
    factor = chain.lean_ratio
    chain = Chain(3, spacing=factor, rotor_length=1.0, rest_angle=math.asin(0.5))
    theory = FlipperTheory(chain)
    assert theory.speed_of_sound == 0
    assert theory.width() == chain.wall_width
    assert theory.energy(0.0) == 0
    assert theory.speed_after_kick(1.0) == 0
    with pytest.raises(ValueError, match='must stay below the speed of sound, 0 m/s'):
        theory.width(1e-9)


@given(any_spinner(), SIGNS, SIGNS, st.sampled_from([0, 1]), FRACTIONS)
def test_both_sublattices_of_a_spinner_solve_their_equation(
    theory, charge, turn, sublattice, fraction
):
    family, velocity = theory.family, fraction * theory.speed_of_sound
    rest = family * theory.chain.rest_angle
    width = theory.width(velocity)
    scaled = np.linspace(-8, 8, 33)

    def theta(shift: float) -> Array:
        positions = (scaled + shift) * width
        return theory.staggered_angles(positions, sublattice, 0.0, velocity, charge, turn)

    sign = family * charge
    assert np.cos(theta(0) - rest) == pytest.approx(-sign * np.tanh(scaled), abs=8 * EPS)
    h = DIFFERENCE
    slopes = (theta(-2 * h) - 8 * theta(-h) + 8 * theta(h) - theta(2 * h)) / (12 * h)
    assert slopes == pytest.approx(sign * np.sin(theta(0) - rest), abs=DIFFERENTIATED)
    forwards = turn * charge * (1 - 2 * sublattice)
    assert (np.sign(np.diff(theta(0))) == forwards).all()


def test_invalid_arguments_are_rejected():
    for call, message in [
        (lambda f, s: FlipperTheory(s.chain), 'is a spinner; use SpinnerTheory'),
        (lambda f, s: SpinnerTheory(f.chain), 'is a flipper; use FlipperTheory'),
        (lambda f, s: SpinnerTheory(s.chain, family=0), r'family = 0 must be'),
        (lambda f, s: f.width(f.speed_of_sound), 'must stay below the speed of sound'),
        (lambda f, s: s.energy(-1.1 * s.speed_of_sound), 'must stay below the speed of sound'),
        (lambda f, s: s.energy(math.nan), 'velocity = nan m/s must stay'),
        (lambda f, s: f.displacements([0.0], 0.0, math.inf), 'velocity = inf m/s must stay'),
        (lambda f, s: f.energy(0.0, 0), r'charge = 0 must be \+1 or -1'),
        (lambda f, s: f.extensions([0.0], charge=2), r'charge = 2 must be'),
        (lambda f, s: s.state(0.0, charge=3), r'charge = 3 must be'),
        (lambda f, s: s.state(0.0, turn=0), r'turn = 0 must be'),
        (lambda f, s: s.extensions([0.0], turn=2), r'turn = 2 must be'),
        (lambda f, s: s.staggered_angles([0.0], 2), 'sublattice = 2 must be 0'),
        (lambda f, s: f.speed_after_kick(math.nan), 'kick = nan m/s must be a finite'),
        (lambda f, s: f.speed_after_kick(1.0, 0.0), 'arc per site = 0.0 must be a finite'),
        (lambda f, s: f.speed_after_kick(1.0, math.inf), 'arc per site = inf must be'),
    ]:
        with pytest.raises(ValueError, match=message):
            call(FlipperTheory(chain_of(FLIPPER, 3)), SpinnerTheory(chain_of(SPINNER, 3)))
