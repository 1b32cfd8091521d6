# SPDX-License-Identifier: Apache-2.0
"""Film of a simulated handmade chain whose manufacturing deviations are known."""

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
    """Parameters of a filmed chain: manufacturing deviations, kick and duration."""

    spread: float = quantity(0.05, 'relative standard deviation of every length', '', 0.0, 0.2)
    seed: int = quantity(
        0, 'first random seed of the lengths; later seeds are tried until a wall can pass', '', 0
    )
    kick: float = quantity(
        10.0, 'speed of rotor 0 along the zero mode at the start of the film', 'rad/s', 0.1, 1000.0
    )
    duration: float = quantity(5.0, 'length of the film', 's', 1.0, 3600.0)


@dataclass(frozen=True)
class FilmedBench:
    """Chain with manufacturing deviations; its markers are made for the nominal chain `plan`."""

    plan: Chain
    markers: MarkerSettings
    parameters: BenchParameters

    @cached_property
    def chain(self) -> Chain:
        """Chain with manufacturing deviations through which a wall can pass."""
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
        """Number of pictures of the film."""
        return round(self.parameters.duration / PERIOD)

    def film(self) -> Iterator[TimedPicture]:
        """Yield the pictures of the chain after a kick, 1280 x 720 pixels at 60 Hz."""
        for number in range(self.pictures):
            time = number * PERIOD
            yield TimedPicture(time, self._renderer.picture(self._begin + time))

    def angles(self, times: Array) -> Array:
        """Return the true angles [rad] at times [s] after the stamp of the first picture."""
        return self._motion(times + self._renderer.stamp(self._begin))[0]

    @property
    def _begin(self) -> float:
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
