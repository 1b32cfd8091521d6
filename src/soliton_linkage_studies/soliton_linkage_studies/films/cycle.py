# SPDX-License-Identifier: Apache-2.0
"""Films of a full cycle of a wall that is reflected at both ends."""

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
    """Settings of a wall at the last rotor that is kicked along the zero mode."""

    chain: Chain
    kick: float
    """Speed r |phi_dot| in units of a sqrt(k_e / M)."""
    duration: float
    """Duration of the motion [s]."""

    @staticmethod
    def read(section: Section) -> KickedWall:
        """Read the settings; the duration is in time units sqrt(M / k_e)."""
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
    """Scene of a kicked chain of springs: zero mode, profile and space-time diagram."""

    caption = f"""
    {LINKAGE} Dashed red lines are springs; {MODE}. {PROJECTIONS}

    Middle: displacement u of each rotor against its position (dots). If the chain has one wall,
    the line shows the continuum theory of a wall at rest at the same position. For a spinner, even
    rotors have filled dots and the solid line; odd rotors have hollow dots and the dashed line.
    The pale line is u = 0.
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
