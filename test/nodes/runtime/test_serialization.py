# SPDX-License-Identifier: Apache-2.0
"""Serialized messages end where their CDR ends, as a strict reader requires."""

from geometry_msgs.msg import PoseWithCovariance
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Empty, String
from visualization_msgs.msg import Marker, MarkerArray

import soliton_linkage_msgs.msg
from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.stored_topic import type_definition
from soliton_linkage_nodes.runtime.serialization import serialize

JOINTS = ['rotor_0', 'rotor_10', 'é']
VALUES = [1.0, 2.0, 3.0]
MESSAGES = [
    JointState(),
    JointState(name=JOINTS),
    JointState(name=JOINTS, position=VALUES),
    JointState(name=JOINTS, velocity=VALUES),
    JointState(name=JOINTS, effort=VALUES),
    JointState(name=JOINTS, position=VALUES, velocity=VALUES, effort=VALUES),
    CameraInfo(d=VALUES),
    CameraInfo(),
    Image(data=bytes(7)),
    PoseWithCovariance(),
    MarkerArray(markers=[Marker(ns='a'), Marker(text='abc')]),
    Empty(),
    String(data='abcd'),
    *(
        kind()
        for kind in vars(soliton_linkage_msgs.msg).values()
        if hasattr(kind, 'get_fields_and_field_types')
    ),
]


def test_a_strict_reader_accepts_the_bytes_of_each_message():
    for message in MESSAGES:
        name = type_name(type(message))
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(type_definition(name)[0], name))
        serialized = serialize(message)
        store.deserialize_cdr(serialized, name)
        assert deserialize_message(serialized, type(message)) == message
