# SPDX-License-Identifier: Apache-2.0
"""Messages become YAML and come back from it, and what does not fit is named."""

import re

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovariance
from sensor_msgs.msg import JointState
from std_msgs.msg import ByteMultiArray, Float64
from std_srvs.srv import SetBool

from soliton_linkage_msgs.msg import Chain
from soliton_linkage_nodes.messages.fields import interface_type, read, to_yaml


def diagnosis() -> DiagnosticArray:
    values = [KeyValue(key='rate', value='50'), KeyValue(key='place', value='ü')]
    return DiagnosticArray(status=[DiagnosticStatus(level=b'\x00', name='chain', values=values)])


def test_a_written_message_reads_back():
    for message in [
        Float64(data=0.25),
        JointState(name=['rotor_0'], position=[0.5], effort=[-1.0]),
        Chain(number_of_rotors=3),
        SetBool.Request(data=True),
        PoseWithCovariance(covariance=[0.5] * 36),
    ]:
        assert read(type(message), to_yaml(message)) == message


def test_messages_in_lists_are_read():
    text = '{status: [{name: chain, values: [{key: rate, value: "50"}, {key: place, value: ü}]}]}'
    assert read(DiagnosticArray, text) == diagnosis()
    assert yaml.safe_load(to_yaml(diagnosis()))['status'][0]['level'] == [0]


def test_whole_numbers_are_taken_for_numbers_with_a_point():
    assert read(Float64, '{data: 10}').data == 10.0
    assert read(JointState, '{position: [1, 2]}').position.tolist() == [1.0, 2.0]


def test_a_value_of_the_wrong_type_is_named():
    for message, text, complaint in [
        (Float64, '{dato: 1}', "std_msgs/msg/Float64 has no field 'dato'; it has data"),
        (Float64, '{data: x}', "std_msgs/msg/Float64: data = 'x' must be of type double"),
        (Float64, '1', '1 must be a mapping of the fields of std_msgs/msg/Float64: {data: ...}'),
        (Float64, '{data: [', "'{data: [' is not YAML: "),
        (JointState, '{name: 3}', 'name = 3 must be of type sequence<string>'),
        (JointState, '{header: {stamp: {sec: x}}}', "Time: sec = 'x' must be of type int32"),
        (
            DiagnosticArray,
            '{status: [1]}',
            '1 must be a mapping of the fields of diagnostic_msgs/msg/Diagno',
        ),
        (SetBool.Request, '{dato: 1}', "std_srvs/srv/SetBool has no field 'dato'; it has data"),
        (ByteMultiArray, '{data: 1}', 'data = 1 must be of type sequence<octet>'),
    ]:
        with pytest.raises(ValueError, match=re.escape(complaint)) as raised:
            read(message, text)
        assert '\n' not in str(raised.value)


def test_types_are_found_by_their_names():
    assert interface_type('std_msgs/msg/Float64', 'msg') is Float64
    assert interface_type('std_msgs/Float64', 'msg') is Float64
    assert interface_type('std_srvs/srv/SetBool', 'srv') is SetBool


def test_types_that_are_not_there_are_named():
    for name, complaint in [
        ('Float64', "'Float64' must be a type name such as PACKAGE/msg/NAME"),
        ('std_srvs/srv/SetBool', 'must be a type name such as PACKAGE/msg/NAME'),
        ('std_msgs/msg/Float63', 'std_msgs/msg/Float63: std_msgs.msg has no Float63'),
        ('no_msgs/msg/Float64', 'no_msgs/msg/Float64: the package no_msgs is not installed'),
    ]:
        with pytest.raises(ValueError, match=re.escape(complaint)):
            interface_type(name, 'msg')
