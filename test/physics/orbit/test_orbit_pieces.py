# SPDX-License-Identifier: Apache-2.0
"""Pieces of the orbit: they join, and have the arc length that they say."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, STRONG_WOBBLER, WOBBLER, chain_of
from linkage_motion import distance

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.orbit_pieces import OrbitPiece, orbit_pieces

EXAMPLES = pytest.mark.parametrize('example', [FLIPPER, WOBBLER, STRONG_WOBBLER, SPINNER])
# Rotors move less than this beyond a piece [1].
STILL = 1e-9


@lru_cache
def pieces_of(example: tuple[float, float], rotors: int) -> list[OrbitPiece]:
    drawn = drawn_deviations(rotors, 5, rotor_length=0.05, spacing=0.05, rest_length=0.05)
    return orbit_pieces(dataclasses.replace(chain_of(example, rotors), deviations=drawn))


def tangent_of(piece: OrbitPiece, arc: float, rotors: int) -> Array:
    tangent = np.zeros(rotors)
    tangent[piece.first : piece.first + piece.rotors] = piece.at(arc)[piece.rotors :]
    return tangent


@EXAMPLES
def test_each_begins_where_the_last_ends(example: tuple[float, float]) -> None:
    pieces = pieces_of(example, 20)
    for piece, after in zip(pieces, [*pieces[1:], pieces[0]], strict=True):
        low = max(piece.first, after.first)
        high = min(piece.first + piece.rotors, after.first + after.rotors)
        end = piece.at(piece.length)[low - piece.first : high - piece.first]
        begin = after.at(0.0)[low - after.first : high - after.first]
        assert distance(end, begin) < STILL
        before = tangent_of(piece, piece.length, 20)
        assert before == pytest.approx(tangent_of(after, 0.0, 20), rel=0, abs=STILL)
        assert before @ before == pytest.approx(1, abs=STILL)


@EXAMPLES
def test_the_arc_is_the_length_of_the_way_of_the_angles(example: tuple[float, float]) -> None:
    for piece in pieces_of(example, 20):
        arcs = np.linspace(0, piece.length, 200)
        angles = np.array([piece.at(arc)[: piece.rotors] for arc in arcs.tolist()])
        way = np.linalg.norm(np.diff(angles, axis=0), axis=1).sum()
        # Chords of 1/200 of a piece are shorter than arcs by a share of the squared curvature.
        assert way == pytest.approx(piece.length, rel=1e-4)
        assert way < piece.length * (1 + 1e-12)
