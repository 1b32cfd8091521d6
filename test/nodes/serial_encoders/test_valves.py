# SPDX-License-Identifier: Apache-2.0
import numpy as np

from soliton_linkage_nodes.serial_encoders.valves import ValveParameters, Valves

TORQUES = np.array([0.02, -0.05])


def test_delivered_impulses_add_up_to_torque_times_time():
    for frame in [0.004, 0.03, 0.9]:
        valves = Valves(ValveParameters(command_timeout=0.2, hold=0.1), 2)
        valves.hold(TORQUES, 1.0)
        for instant in (1.0, 1.05, 1.11, 1.25):
            valves.command(instant)
            valves.record_sent(instant)
        frames = [valves.delivered(instant) for instant in np.arange(0.5, 2.5, frame)]
        np.testing.assert_allclose(np.sum(frames, axis=0), (0.05 + 0.06 + 0.1) * TORQUES)
        assert not valves.delivered(9.0).any()


def test_feedback_is_added_to_commanded_torques_and_ends_with_the_hold_time():
    valves = Valves(ValveParameters(command_timeout=0.2, hold=0.1), 2)
    valves.hold(TORQUES, 1.0)
    valves.feed_back(2 * TORQUES, 1.0)
    for instant, torques in [(1.0, 3 * TORQUES), (1.15, TORQUES), (1.25, 0 * TORQUES)]:
        np.testing.assert_allclose(valves.command(instant).values, torques)
        assert valves.closed is not torques.any()
        valves.record_sent(instant)
    np.testing.assert_allclose(valves.delivered(9.0), 0.2 * TORQUES)


def test_commands_that_were_not_sent_deliver_nothing():
    valves = Valves(ValveParameters(), 2)
    valves.hold(TORQUES, 1.0)
    valves.command(1.0)
    assert not valves.delivered(2.0).any()
