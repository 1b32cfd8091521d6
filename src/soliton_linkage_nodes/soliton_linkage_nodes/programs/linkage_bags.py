# SPDX-License-Identifier: Apache-2.0
"""The chain of a bag and the motion of its joints."""

from __future__ import annotations

import numpy as np
from rosbags.rosbag2 import Reader

from soliton_linkage.linkage.recording import Recording
from soliton_linkage_nodes.bags.read.reading import read_topic
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_from_msg, frame_from_msg
from soliton_linkage_nodes.runtime.stamps import time_from_msg


def read_chain(reader: Reader) -> NamedChain:
    """Return the last chain that a bag holds."""
    chains = [message for _, message in read_topic(reader, 'chain')]
    if not chains:
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic chain')
    return chain_from_msg(chains[-1])


def read_recording(reader: Reader) -> tuple[NamedChain, Recording]:
    """Return the chain of a bag and its joint states; time 0 is the first frame."""
    named = read_chain(reader)
    messages = [message for _, message in read_topic(reader, 'joint_states')]
    if not messages:
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic joint_states')
    frames = [frame_from_msg(named, message) for message in messages]
    stamps = [time_from_msg(message.header.stamp) for message in messages]
    times = np.array([stamp - stamps[0] for stamp in stamps], dtype=np.float64) * 1e-9
    rates = [frame.rates for frame in frames if frame.rates is not None]
    complete = np.array(rates) if len(rates) == len(frames) else np.empty((0, named.rotors))
    return named, Recording(times, np.array([frame.angles for frame in frames]), complete)
