# SPDX-License-Identifier: Apache-2.0
"""Bags of any length with noisy frames of a chain with a moving wall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

START = 10**18
NOISE = 0.01
RATE = 1000
SECOND = 10**9
_ARC_RATE = 10.0
_DRAWS = 2**20
_SHOW_EVERY = 1000


def named_chain(rotors: int) -> NamedChain:
    """Return a flipper chain with its joint names."""
    return NamedChain(Chain(number_of_rotors=rotors), default_joint_names(rotors))


class NoisyWall:
    """Noisy frames at 1000 Hz of a wall that moves along the orbit."""

    def __init__(
        self, rotors: int, deviation: float = NOISE, begin: float = 0.0, rate: float = _ARC_RATE
    ) -> None:
        """Draw the noise, which repeats after a million numbers.

        The wall starts at the position `begin` [rotor spacings] and moves at `rate` [rad/s].
        """
        self._rotors = rotors
        self._orbit = UniformOrbit(Chain(number_of_rotors=rotors))
        self._begin, self._rate = self._orbit.arc_at(begin, 0) if begin else 0.0, rate
        self._noise = deviation * np.random.default_rng(1).standard_normal(_DRAWS + 2 * rotors)

    def frame(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return angles [rad] and rates [rad/s] of a frame, each of shape (N,)."""
        arc = self._arc(number)
        about = self._orbit.segment(arc)
        begin = number * 2 * self._rotors % _DRAWS
        noise = self._noise[begin : begin + 2 * self._rotors]
        angles = self._orbit.configuration(arc) + noise[: self._rotors]
        rates = noise[self._rotors :].copy()
        rates[about.first : about.first + len(about.tangent)] += self._rate * about.tangent
        return angles, rates

    def position(self, number: int) -> float:
        """Return the position of the wall in a frame [rotor spacings]."""
        return self._orbit.site(self._arc(number))

    def _arc(self, number: int) -> float:
        return self._begin + self._rate / RATE * number


def write_wall_bag(name: Path, rotors: int, frames: int, compression: str = 'none') -> Path:
    """Write a number of frames with a period of 1 ms; return the path of the bag."""
    named, wall = named_chain(rotors), NoisyWall(rotors)
    buffer, still = JointStateBuffer(named), np.zeros(rotors)
    writer = BagWriter(name, compression)
    chain_topic, joints = (
        writer.add_topic(f'/{topic.name}', type_name(topic.type), topic.qos)
        for topic in (interfaces.CHAIN, interfaces.JOINT_STATES)
    )
    writer.write(chain_topic, START, serialize_message(chain_to_msg(named, time_to_msg(START))))
    progress = ProgressLine('writing', frames)
    for number in range(frames):
        stamp = START + number * SECOND // RATE
        writer.write(joints, stamp, bytes(buffer.fill(stamp, *wall.frame(number), still)))
        if number % _SHOW_EVERY == 0:
            progress.show(number)
    writer.close()
    progress.end(f'{frames} frames of {rotors} rotors, {frames * len(buffer) / 1e9:.3g} GB')
    return writer.path
