# SPDX-License-Identifier: Apache-2.0
import array
import struct

import pytest
import rclpy
from sensor_msgs.msg import CompressedImage

from soliton_linkage_nodes.live_view.chain_topics import CameraTopic
from soliton_linkage_nodes.messages.picture_conversions import jpeg_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

JPEG = b'\xff\xd8\xff\xe0 and so on'


@pytest.fixture
def camera(graph):
    # No executor spins the node that receives pictures.
    node = rclpy.create_node('inbox', context=graph.context)
    made = CameraTopic(node, '/')
    yield made
    made.close()
    node.destroy_node()


def test_it_subscribes_while_a_page_shows_the_pictures_and_keeps_the_newest(graph, camera):
    camera.show(True)
    camera.update()
    assert camera.reason == 'no node publishes camera_overlay; start camera_encoders'
    publisher = interfaces.CAMERA_OVERLAY.publisher(graph.user)

    def is_subscribed(shown: bool) -> bool:
        camera.adapt()
        camera.show(shown)
        return publisher.get_subscription_count() == shown and not camera.reason

    def receive(data: bytes, pictures: int) -> None:
        message = CompressedImage(format='jpeg', data=array.array('B', data))
        message.header.stamp = time_to_msg(3 * 10**9)
        publisher.publish(message)
        graph.until(lambda: camera.update() or camera.pictures == pictures, 'the picture')

    graph.until(lambda: is_subscribed(True), 'the subscription')
    receive(JPEG, 1)
    chain, stamp, age = struct.unpack_from('<3d', camera.packed(4), 8)
    assert (chain, stamp) == (4.0, 3.0)
    assert 0 <= age < 60
    assert camera.packed(4)[32:] == JPEG
    receive(JPEG[:-1], 2)
    assert camera.packed(4)[32:] == JPEG[:-1]
    graph.until(lambda: is_subscribed(False), 'the end of the subscription')
    assert camera.pictures == 0


def test_a_picture_that_no_browser_can_show_is_rejected():
    for data, reason in [
        (b'', '0 bytes of format .* are no JPEG; send jpeg'),
        (b'\x89PNG and so on', '14 bytes of format .* are no JPEG; send jpeg'),
        (JPEG.ljust(4_000_001), 'a picture of 4000001 bytes exceeds the limit of 4000000'),
    ]:
        message = CompressedImage(format='png', data=array.array('B', data))
        with pytest.raises(ValueError, match=reason):
            jpeg_from_msg(message, 4_000_000)
