# SPDX-License-Identifier: Apache-2.0
"""A home-made chain before a camera: what nobody has measured of it is known here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import numpy as np

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage.vision.video import TimedPicture
from soliton_linkage_studies.camera.renderer import FilmSettings, Motion, Renderer
from soliton_linkage_studies.camera.runs import (
    CAMERA,
    PERIOD,
    SIMULATED,
    chain_plane,
    interpolate_motion,
)


@dataclass(frozen=True)
class BenchParameters:
    """How the chain was made, kicked and filmed."""

    spread: float = quantity(
        0.05, 'standard deviation of every length over what was meant', '', 0.0, 0.2
    )
    seed: int = quantity(0, 'of the lengths; the first from it on that let a wall pass', '', 0)
    kick: float = quantity(
        10.0, 'speed of rotor 0 along its zero mode as the film begins', 'rad/s', 0.1, 1000.0
    )
    duration: float = quantity(5.0, 'length of the film', 's', 1.0, 3600.0)


@dataclass(frozen=True)
class FilmedBench:
    """A chain made by a plan, with the markers that were printed for the plan."""

    plan: Chain
    markers: MarkerSettings
    parameters: BenchParameters

    @cached_property
    def chain(self) -> Chain:
        """As it was made."""
        rotors, spread = self.plan.number_of_rotors, self.parameters.spread
        for seed in count(self.parameters.seed):
            lengths = drawn_deviations(
                rotors, seed, spacing=spread, rotor_length=spread, rest_length=spread
            )
            made = replace(self.plan, deviations=lengths)
            if not blocked_bonds(made).any():
                break
        return made

    @cached_property
    def pictures(self) -> int:
        """Of the film."""
        return round(self.parameters.duration / PERIOD)

    def film(self) -> Iterator[TimedPicture]:
        """Pictures of the chain from its kick on, 60 a second of 1280 x 720 pixels."""
        for number in range(self.pictures):
            time = number * PERIOD
            yield TimedPicture(time, self._renderer.picture(self._begin + time))

    def angles(self, times: Array) -> Array:
        """True angles [rad] at times from that of the angles in the first picture on [s]."""
        return self._motion(times + self._renderer.stamp(self._begin))[0]

    @property
    def _begin(self) -> float:
        """Of the first picture, whose first row is exposed before the others [s]."""
        return CAMERA.row_time * CAMERA.height

    @cached_property
    def _renderer(self) -> Renderer:
        printed = MarkerLayout(self.plan, self.markers).as_printed
        layout = MarkerLayout(self.chain, printed)
        return Renderer(layout, chain_plane(layout), self._motion, FilmSettings())

    @cached_property
    def _motion(self) -> Motion:
        start = leaning(self.chain, -1).angles
        rates = self.parameters.kick * edge_mode(self.chain, start, Edge.FIRST)
        whole = self.parameters.duration + 10 * PERIOD
        return interpolate_motion(simulate(self.chain, start, rates, np.ceil(whole), SIMULATED))
