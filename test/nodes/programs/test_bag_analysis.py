# SPDX-License-Identifier: Apache-2.0
"""The chain and the motion of a bag are those that were recorded."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from recordings import frame_message, run_of, write_bag

from soliton_linkage_nodes.bags.reading import open_bag, type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.programs.bag_analysis import read_recording
from soliton_linkage_nodes.runtime import interfaces


def test_the_recording_of_a_bag_is_in_seconds_since_its_first_frame(named, tmp_path):
    path = write_bag(tmp_path / 'run', run_of(named, 20), namespace='/lab')
    with open_bag(path) as reader:
        chain, recording = read_recording(reader)
    assert chain == named
    np.testing.assert_allclose(recording.times, 1e-3 * np.arange(20), rtol=1e-15)
    expected = [frame_message(named, number) for number in range(20)]
    np.testing.assert_array_equal(recording.angles, [message.position for message in expected])
    np.testing.assert_array_equal(recording.rates, [message.velocity for message in expected])


def test_a_recording_without_rates_has_none(named, tmp_path):
    entries = run_of(named, 3)
    entries[2][2].velocity = []
    with open_bag(write_bag(tmp_path / 'run', entries)) as reader:
        _, recording = read_recording(reader)
    assert recording.rates.shape == (0, named.rotors)


@pytest.mark.parametrize('missing', ['chain', 'joint_states'])
def test_a_recording_needs_messages_of_the_chain_and_of_its_joints(tmp_path, named, missing):
    entries = [entry for entry in run_of(named, 2) if entry[0].name != missing]
    writer = BagWriter(tmp_path / 'run')
    for topic in (interfaces.CHAIN, interfaces.JOINT_STATES):
        connection = writer.add_topic(topic.name, type_name(topic.type), topic.qos)
        for other, stamp, message in entries:
            if other is topic:
                writer.write(connection, stamp, serialize_message(message))
    writer.close({})
    with open_bag(writer.path) as reader:
        remedy = '; record the topic chain$' if missing == 'chain' else '$'
        said = f'has no message on the topic {missing}{remedy}'
        with pytest.raises(ValueError, match=said):
            read_recording(reader)
