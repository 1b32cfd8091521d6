# SPDX-License-Identifier: Apache-2.0
"""What a bag holds of a chain: its angles, what pushed it, and how it was tilted."""

from __future__ import annotations

import sys

from rosbags.rosbag2 import Reader

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.read.reading import decoder, find_topic, read_messages
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.messages.conversions import NamedChain, joint_states_from_msg
from soliton_linkage_nodes.messages.frame_reader import EncoderWatch
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND

_FEWEST_FRAMES = 50
"""That are looked at [1]: a wall passes a rotor or two in them."""
_MOST_FRAMES = 8000
"""Frames that are adjusted together [1]: bars of 40 rotors take some ten seconds."""


def read_joints(reader: Reader, told: NamedChain | None, span: tuple[float, float]) -> JointRecord:
    """Angles, their standard deviations, pushes and tilts, in the order of a chain's joints.

    Frames count in a span of times from the first on [s].
    """
    joints = find_topic(reader, 'joint_states')
    others = {
        topic.name
        for topic in (
            interfaces.JOINT_STATE_DEVIATIONS,
            interfaces.DELIVERED_IMPULSES,
            interfaces.DELIVERY,
            interfaces.ROTOR_IMPULSES,
            interfaces.ROTOR_TORQUES,
            interfaces.TILT,
        )
    }
    wanted = [
        joints,
        *(each for each in reader.connections if each.topic.rpartition('/')[2] in others),
    ]
    decoders = {connection.topic: decoder(connection) for connection in wanted}
    progress = ProgressLine('reading', joints.msgcount)
    watch = EncoderWatch(lambda line: print(f'identify_chain: {line}', file=sys.stderr))
    record = JointRecord(told.joint_names if told else (), _MOST_FRAMES)
    first = None
    for connection, received, serialized in read_messages(reader, wanted):
        message = decoders[connection.topic](serialized)
        if connection is joints:
            states = joint_states_from_msg(message)
            first = states.stamp if first is None else first
            if span[0] <= (states.stamp - first) / SECOND <= span[1]:
                record.add(states)
            watch.look(states.stamp, states.position)
            progress.show(record.frames, f'{record.frames} frames')
        elif connection.topic.endswith(interfaces.JOINT_STATE_DEVIATIONS.name):
            record.add_deviations(joint_states_from_msg(message))
        elif connection.topic.endswith(interfaces.TILT.name):
            record.add_tilt(message.data, received)
        elif connection.topic.endswith(interfaces.DELIVERED_IMPULSES.name):
            record.add_delivered(message)
        elif connection.topic.endswith(interfaces.DELIVERY.name):
            record.add_delivery(message)
        else:
            record.add_push(message, received)
    progress.clear()
    if len(record) < _FEWEST_FRAMES:
        raise ValueError(
            f'{len(record)} of {joints.msgcount} frames lie between --begin {span[0]:g} s and '
            f'--end {span[1]:g} s, which is too few to identify a chain; leave them out'
        )
    if left_out := record.frames - len(record):
        print(
            f'identify_chain: of {record.frames} frames {left_out} are left out, rather of rotors '
            'at rest, and none near pushes; --begin and --end choose a time of which more stay',
            file=sys.stderr,
        )
    return record
