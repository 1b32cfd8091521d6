# SPDX-License-Identifier: Apache-2.0
"""From joint states to what they show: the one way of the live node, replays and offline work."""

from __future__ import annotations

import math
from collections.abc import Sequence

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis, FrameAnalyser, UnknownChainAnalyser
from soliton_linkage.estimation.frames import check_deviations
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.cdr import ImpulseDecoder, read_stamp
from soliton_linkage_nodes.messages.conversions import Frame, JointStates, NamedChain
from soliton_linkage_nodes.messages.frame_reader import FrameReader

_MOST_WAITING = 1000
"""Deviations that wait for their frames [1]: as many as frames may wait."""


class JointStateAnalysis:
    """Analyses joint states of a chain that is told first, or is not known."""

    def __init__(self, noise: float | None = None) -> None:
        """Wait for a chain; the noise of its angles is in rad, None to have it estimated."""
        self._noise = noise
        self._named: NamedChain | None = None
        self._reader: FrameReader | None = None
        self._impulses: ImpulseDecoder | None = None
        self._deviation_reader: FrameReader | None = None
        self._deviations: dict[int, Array] = {}
        self.analyser: FrameAnalyser | None = None
        self.latest: Analysis | None = None
        self.frame: Frame | None = None
        """The frame that was read last."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, rotor 0 first."""
        return () if self._reader is None else self._reader.joint_names

    @property
    def spacing(self) -> float:
        """Distance between neighbouring pivots [m], NaN where the chain is not known."""
        return math.nan if self._named is None else self._named.chain.spacing

    def set_chain(self, named: NamedChain) -> None:
        """Analyse the frames of this chain from now on; what is known of it already is kept."""
        if named == self._named:
            return
        if self._named is None or named.chain != self._named.chain:
            self.analyser = Analyser(named.chain, self._noise)
        self._named = named
        self._reader = FrameReader(named.joint_names, named.encoder_offsets)
        self._impulses = ImpulseDecoder(named.numbers, math.inf)
        self._deviation_reader, self._deviations = FrameReader(named.joint_names), {}

    def set_joints(self, joint_names: Sequence[str]) -> None:
        """Analyse the frames of joints of which nothing is known but their order."""
        self.analyser = UnknownChainAnalyser(len(joint_names))
        self._named, self._reader = None, FrameReader(joint_names)
        self._impulses = self._deviation_reader = None

    def add_impulses(self, serialized: bytes) -> None:
        """Take `delivered_impulses`, as CDR bytes, for what acts on a wall from their stamp on.

        Of a chain that is not known they tell nothing. Raises ValueError for impulses that are
        refused.
        """
        if isinstance(self.analyser, Analyser) and self._impulses is not None:
            impulses = self._impulses.decode(serialized)
            self.analyser.apply_impulse(read_stamp(serialized) or None, impulses)

    def add_deviations(self, deviations: JointStates) -> None:
        """Take `joint_state_deviations` for those of the angles of that stamp, which come later.

        Of a chain that is not known they tell nothing. Raises ValueError for what is refused.
        """
        if self._deviation_reader is None:
            return
        by_rotor = self._deviation_reader.read(deviations).angles
        self._deviations[deviations.stamp] = check_deviations(by_rotor, len(by_rotor))
        if len(self._deviations) > _MOST_WAITING:
            del self._deviations[next(iter(self._deviations))]

    def analyse(self, joints: JointStates) -> Analysis | None:
        """What a frame shows, None for one that is not later than the one before.

        Raises ValueError for joint states that are refused, and before any chain is known.
        """
        if self.analyser is None or self._reader is None:
            raise ValueError('joint_states came before the chain was known; tell it first')
        frame = self.frame = self._reader.read(joints)
        stamp = joints.stamp
        deviations = self._deviations.pop(stamp, None)
        analysis = self.analyser.analyse(stamp, frame.angles, frame.rates, deviations)
        if analysis is not None:
            self.latest = analysis
        return analysis
