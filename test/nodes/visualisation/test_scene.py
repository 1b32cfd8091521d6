# SPDX-License-Identifier: Apache-2.0
"""Laws of the drawing in space."""

import dataclasses

import numpy as np
import pytest

from soliton_linkage.colours import BLUE, GREY, RED, shares
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage_nodes.visualisation.scene import ChainScene, Shape

CHAIN = Chain(
    number_of_rotors=9, deviations=drawn_deviations(9, 5, spacing=0.05, rotor_length=0.05)
)
ANGLES = CHAIN.uniform_state(1) + np.random.default_rng(4).normal(0, 0.2, 9)


def shape(name: str, angles: Array = ANGLES, chain: Chain = CHAIN) -> Shape:
    (found,) = (each for each in ChainScene(chain).shapes(angles) if each.name == name)
    return found


def test_rods_lead_from_the_pivots_to_the_masses():
    rods = shape('rotors').points.reshape(-1, 2, 3)
    np.testing.assert_array_equal(rods[:, 0, 0], CHAIN.pivots)
    lengths = np.linalg.norm(rods[:, 1] - rods[:, 0], axis=1)
    np.testing.assert_allclose(lengths, CHAIN.rotor_lengths)
    np.testing.assert_array_equal(shape('masses').points, rods[:, 1])


def test_springs_have_the_length_and_colour_of_their_extension():
    springs = shape('springs')
    lines, colours = springs.points.reshape(-1, 2, 3), springs.colours[::2, :3]
    lengths = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    extensions = CHAIN.spring_extensions(ANGLES)
    np.testing.assert_allclose(lengths - CHAIN.rest_lengths, extensions, atol=1e-15)
    furthest = int(np.argmax(np.abs(extensions)))
    np.testing.assert_allclose(
        colours[furthest], shares(RED if extensions[furthest] > 0 else BLUE)
    )
    redder = colours @ [1, 0, -1] - np.dot(shares(GREY), [1, 0, -1])
    assert (np.sign(redder) == np.sign(extensions)).all()


def test_a_chain_at_rest_has_grey_springs():
    alike = Chain(number_of_rotors=6)
    colours = shape('springs', alike.uniform_state(-1), alike).colours
    np.testing.assert_allclose(colours[:, :3], np.tile(shares(GREY), (10, 1)), atol=1e-6)


def test_arrows_of_the_zero_mode_follow_the_motion_of_the_masses():
    mode = resolved_edge_mode(CHAIN, ANGLES, Edge.NEAREST)[1]
    shafts = shape('zero_mode').points.reshape(-1, 3, 2, 3)[:, 0]
    shown = np.abs(mode) > 0.02 * np.abs(mode).max()
    assert len(shafts) == shown.sum()
    step = 1e-6 * mode
    moved = (ChainScene(CHAIN).masses(ANGLES + step) - ChainScene(CHAIN).masses(ANGLES - step))[
        shown
    ]
    along = shafts[:, 1] - shafts[:, 0]
    cosines = np.sum(along * moved, axis=1) / (
        np.linalg.norm(along, axis=1) * np.linalg.norm(moved, axis=1)
    )
    np.testing.assert_allclose(cosines, 1.0, atol=1e-9)
    lengths = np.linalg.norm(along, axis=1)
    np.testing.assert_allclose(lengths / lengths.max(), np.abs(mode[shown]) / np.abs(mode).max())


def test_parts_of_a_missing_joint_are_omitted():
    angles = ANGLES.copy()
    angles[4] = np.nan
    counts = {each.name: len(each.points) for each in ChainScene(CHAIN).shapes(angles)}
    assert counts == {'rotors': 16, 'masses': 8, 'springs': 12, 'zero_mode': 0}
    assert all(np.isfinite(each.points).all() for each in ChainScene(CHAIN).shapes(angles))


def test_a_ring_has_a_spring_beyond_its_last_rotor_and_no_mode():
    ring = dataclasses.replace(Chain(number_of_rotors=6), periodic=True)
    angles = ring.uniform_state(1)
    springs = shape('springs', angles, ring).points.reshape(-1, 2, 3)
    lengths = np.linalg.norm(springs[:, 1] - springs[:, 0], axis=1)
    np.testing.assert_allclose(lengths, ring.rest_length)
    assert not len(shape('zero_mode', angles, ring).points)


def test_a_wall_spans_two_standard_deviations_to_each_side():
    for deviation, length in [(0.02, 0.08), (0.0, ChainScene(CHAIN).width)]:
        (box,) = ChainScene(CHAIN).boxes([(0.3, deviation), (float('nan'), 0.1)])
        assert (box.position, box.length) == (0.3, pytest.approx(length))
