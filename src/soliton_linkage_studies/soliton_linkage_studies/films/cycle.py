# SPDX-License-Identifier: Apache-2.0
"""Films of walls that run to and fro until every rotor is back."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.captions import LINKAGE, MODE, PROJECTIONS, description
from soliton_linkage_studies.drawing import ChainPicture
from soliton_linkage_studies.experiments import kick_rates
from soliton_linkage_studies.films.scenes import (
    SPACE_TIME,
    TOLERANCE,
    Format,
    ProfilePanel,
    Scene,
    SpaceTime,
    film_kind,
    stacked,
)
from soliton_linkage_studies.settings import Section, chain_from


@dataclass(frozen=True)
class KickedWall:
    """A wall sent through a chain from its last rotor, by a kick along the zero mode."""

    chain: Chain
    kick: float
    """Speed r |phi_dot| in units of a sqrt(k_e / M)."""
    duration: float
    """Of the motion [s]."""

    @staticmethod
    def read(section: Section) -> KickedWall:
        """Read the settings, the duration in time units sqrt(M / k_e)."""
        section.check_keys('chain', 'kick', 'duration')
        chain = chain_from(section.section('chain'))
        kick = section.number('kick', 1e-6, 100.0)
        duration = section.number('duration', 1e-3, 1e6)
        return KickedWall(chain, kick, duration * chain.time_unit)

    def describe(self) -> str:
        """Return one line with the chain and the kick."""
        return f'{description(self.chain)}, v₀ = {self.kick:g} a√(kₑ/M)'


@film_kind('cycle', KickedWall.read)
class CycleScene(Scene):
    """A kicked chain of springs, its zero mode, its profile and its space-time picture."""

    caption = f"""
    {LINKAGE} Dashed red lines are springs; {MODE}. {PROJECTIONS}

    In the middle dots are u of each rotor over its place, and the line is the continuum's u of a
    wall at rest at the same place, where there is one wall; a spinner's even rotors are filled and
    have the solid line, its odd ones are hollow and have the dashed line. The pale line is u = 0.
    {SPACE_TIME}
    """

    def __init__(self, title: str, motion: KickedWall, shape: Format) -> None:
        """Simulate the motion and draw its first frame."""
        chain = motion.chain
        super().__init__(title, motion.describe(), shape, motion.duration, chain.time_unit)
        rest = chain.uniform_state(1)
        rates = kick_rates(chain, rest, motion.kick)
        simulation = ElasticSimulation(chain, rest, rates, self.period, TOLERANCE)
        self.angles = simulation.record(motion.duration).angles
        above, middle, below = stacked(self.figure, chain, (0.45, 0.55))
        mode = zero_mode(chain, rest)
        self._picture = ChainPicture(above, chain, rest, mode, projections=True)
        self._profile = ProfilePanel(middle, chain)
        self._space_time = SpaceTime(below, chain, self.angles, motion.duration)
        for part in (self._picture.artists, self._profile.moving, self._space_time.moving):
            self.add_moving(part)
        self.show(0)

    def _move(self, frame: int) -> None:
        angles = self.angles[frame]
        self._picture.update(angles, zero_mode(self._picture.chain, angles))
        self._profile.show(angles)
        self._space_time.show(frame)
