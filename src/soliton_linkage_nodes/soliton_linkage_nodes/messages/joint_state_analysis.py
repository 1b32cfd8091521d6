# SPDX-License-Identifier: Apache-2.0
"""Analysis of joint states in the live node, in replays and in offline programs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis, FrameAnalyser, UnknownChainAnalyser
from soliton_linkage.estimation.frames import check_deviations
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.cdr import ImpulseDecoder
from soliton_linkage_nodes.messages.conversions import Frame, JointStates, NamedChain
from soliton_linkage_nodes.messages.frames import FrameAssembler, FrameReader
from soliton_linkage_nodes.runtime.stamps import stamp_of

_MOST_WAITING = 1000
"""Largest number of messages with standard deviations that are stored until the frame with the
same stamp arrives [1]."""


class JointStateAnalysis:
    """Analysis of the joint states of a chain. The chain parameters may be unknown."""

    def __init__(self, noise: float | None = None) -> None:
        """Set the standard deviation of the encoder noise [rad], or None if it is unknown."""
        self._noise = noise
        self._named: NamedChain | None = None
        self._reader: FrameReader | None = None
        self._impulses: ImpulseDecoder | None = None
        self._deviation_reader: FrameReader | None = None
        self._deviations: dict[int, Array] = {}
        self.analyser: FrameAnalyser | None = None
        self.assembler = FrameAssembler()
        """Assembler that merges messages with different joints into the frames for `analyse`."""
        self._unseen: set[int] = set()
        self.latest: Analysis | None = None
        self.frame: Frame | None = None

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, rotor 0 first."""
        return () if self._reader is None else self._reader.joint_names

    @property
    def absent(self) -> tuple[str, ...]:
        """Names of the joints whose angles were missing in every frame so far."""
        return tuple(self.joint_names[rotor] for rotor in sorted(self._unseen))

    @property
    def spacing(self) -> float:
        """Distance between neighbouring pivots [m]; NaN if the chain is unknown."""
        return math.nan if self._named is None else self._named.chain.spacing

    def set_chain(self, named: NamedChain) -> None:
        """Set the chain of the later frames. Setting an equal chain again changes nothing."""
        if named == self._named:
            return
        if self._named is None or named.chain != self._named.chain:
            self.analyser = Analyser(named.chain, self._noise)
        self._named = named
        self._set_reader(FrameReader(named.joint_names, named.encoder_offsets))
        self._impulses = ImpulseDecoder(named.numbers, math.inf)
        self._deviation_reader, self._deviations = FrameReader(named.joint_names), {}

    def set_joints(self, joint_names: Sequence[str]) -> None:
        """Set the joints of the later frames, rotor 0 first, and treat the chain as unknown.

        A chain that was set earlier is no longer used.
        """
        self.analyser = UnknownChainAnalyser(len(joint_names))
        self._named = None
        self._set_reader(FrameReader(joint_names))
        self._impulses = self._deviation_reader = None

    def add_impulses(self, serialized: bytes) -> None:
        """Add the impulses of a `delivered_impulses` message, unless the chain is unknown."""
        if isinstance(self.analyser, Analyser) and self._impulses is not None:
            impulses = self._impulses.decode(serialized)
            self.analyser.apply_impulse(stamp_of(serialized) or None, impulses)

    def add_deviations(self, deviations: JointStates) -> None:
        """Store standard deviations for the frame with the same stamp.

        If the chain is unknown, nothing is stored.
        """
        if self._deviation_reader is None:
            return
        by_rotor = self._deviation_reader.read(deviations).angles
        by_rotor = check_deviations(by_rotor, len(by_rotor))
        before = self._deviations.get(deviations.stamp, by_rotor)
        merged = np.where(np.isnan(by_rotor), before, by_rotor)
        self._deviations[deviations.stamp] = merged
        if len(self._deviations) > _MOST_WAITING:
            del self._deviations[next(iter(self._deviations))]

    def analyse(self, joints: JointStates) -> Analysis | None:
        """Analyse a frame. Return None if the frame is late.

        A frame is late if its stamp equals the previous stamp or is up to 1 s earlier. If the
        stamp is even earlier, the analysis restarts with this frame. Raises ValueError if the
        frame is invalid.
        """
        if self.analyser is None or self._reader is None:
            raise ValueError(
                'joint_states arrived before the chain; set the chain or the joints first'
            )
        frame = self.frame = self._reader.read(joints)
        if self._unseen:
            self._unseen.difference_update(np.flatnonzero(~np.isnan(frame.angles)).tolist())
        stamp = joints.stamp
        deviations = self._deviations.pop(stamp, None)
        analysis = self.analyser.analyse(stamp, frame.angles, frame.rates, deviations)
        if analysis is not None:
            self.latest = analysis
        return analysis

    def _set_reader(self, reader: FrameReader) -> None:
        self._reader = reader
        self.assembler = FrameAssembler(reader.joint_names)
        self._unseen = set(range(len(reader.joint_names)))
