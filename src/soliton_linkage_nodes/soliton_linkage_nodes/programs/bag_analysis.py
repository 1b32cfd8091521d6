# SPDX-License-Identifier: Apache-2.0
"""Analysis of the frames in a bag with the same methods as in the node soliton_analyser."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.linkage.recording import Recording
from soliton_linkage_nodes.bags.bag_files import BagReader
from soliton_linkage_nodes.bags.reading import decoder, find_topic, is_older, read_topic
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.messages.cdr import JointStateDecoder, stamped
from soliton_linkage_nodes.messages.conversions import (
    JointStates,
    NamedChain,
    chain_from_msg,
    frame_from_msg,
    joint_states_from_msg,
)
from soliton_linkage_nodes.messages.frames import FrameAssembler
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis
from soliton_linkage_nodes.runtime import interfaces

_RECORD_CHAIN = 'record the topic chain'
_MAX_LINES = 3
"""Largest number of rejected messages of a topic that are printed one by one [1]. If a topic has
more, the number of all its rejected messages is printed at the end."""


def analyse_frames(
    reader: BagReader,
    given: NamedChain | None = None,
    analysis: JointStateAnalysis | None = None,
    log_time: bool = False,
) -> Iterator[tuple[JointStates, Analysis | None]]:
    """Yield each frame of a bag and its analysis, which is None for a late frame.

    A frame is late if its stamp is not after the stamp of the last analysed frame. `given`
    replaces the chain in the bag. With `log_time`, the receive times replace the stamps. Raises
    ValueError if the bag has no joint states.
    """
    analysis = analysis or JointStateAnalysis()
    joints = find_topic(reader, interfaces.JOINT_STATES.name)
    topics = [joints]
    if given is None:
        first = next((message for _, message in read_topic(reader, 'chain')), None)
        analysis.set_chain(read_chain(reader) if first is None else chain_from_msg(first))
        topics.append(find_topic(reader, 'chain'))
    else:
        analysis.set_chain(given)
    decode_joints = _decoder(joints)
    chain_decoders = {topic.number: decoder(topic) for topic in topics[1:]}
    namespace = joints.name.rpartition('/')[0]
    impulses, deviations = (
        [each for each in reader.topics if each.name == f'{namespace}/{topic.name}']
        for topic in (interfaces.DELIVERED_IMPULSES, interfaces.JOINT_STATE_DEVIATIONS)
    )
    deviation_decoders = {topic.number: _decoder(topic) for topic in deviations}
    rejections: Counter[str] = Counter()
    wanted = [*topics, *impulses, *deviations]
    for topic, received, serialized in reader.messages(wanted):
        if topic.number in chain_decoders:
            analysis.set_chain(chain_from_msg(chain_decoders[topic.number](serialized)))
            continue
        serialized = stamped(serialized, received) if log_time else serialized
        try:
            if topic in impulses:
                analysis.add_impulses(serialized)
                continue
            if topic.number in deviation_decoders:
                analysis.add_deviations(deviation_decoders[topic.number](serialized))
                continue
            for frame in analysis.assembler.add(decode_joints(serialized)):
                yield frame, analysis.analyse(frame)
        except ValueError as error:
            name = topic.name.rpartition('/')[2]
            rejections[name] += 1
            if rejections[name] <= _MAX_LINES:
                print(f'rejected {name}: {error}', file=sys.stderr)
    for frame in analysis.assembler.flush():
        yield frame, analysis.analyse(frame)
    for name, count in rejections.items():
        if count > _MAX_LINES:
            print(f'rejected {name}: {count} in all', file=sys.stderr)


def _decoder(topic: StoredTopic) -> Callable[[bytes], JointStates]:
    if not is_older(topic):
        return JointStateDecoder().decode
    decode = decoder(topic)
    return lambda serialized: joint_states_from_msg(decode(serialized))


def read_chain(reader: BagReader, remedy: str = _RECORD_CHAIN) -> NamedChain:
    """Return the last chain in a bag.

    Raises ValueError, with a text that ends with `remedy`, if the bag contains no chain.
    """
    chains = [message for _, message in read_topic(reader, 'chain', remedy)]
    if not chains:
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic chain; {remedy}')
    return chain_from_msg(chains[-1])


def read_recording(reader: BagReader) -> tuple[NamedChain, Recording]:
    """Return the last chain in a bag, and all frames at times relative to the first frame."""
    named = read_chain(reader)
    messages = [message for _, message in read_topic(reader, 'joint_states')]
    if not messages:
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic joint_states')
    assembler = FrameAssembler(named.joint_names)
    joints = list(assembler.add_all(map(joint_states_from_msg, messages)))
    frames = [frame_from_msg(named, each) for each in joints]
    stamps = [each.stamp for each in joints]
    times = np.array([stamp - stamps[0] for stamp in stamps], dtype=np.float64) * 1e-9
    rates = [frame.rates for frame in frames if frame.rates is not None]
    complete = np.array(rates) if len(rates) == len(frames) else np.empty((0, named.rotors))
    return named, Recording(times, np.array([frame.angles for frame in frames]), complete)
