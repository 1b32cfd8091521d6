# SPDX-License-Identifier: Apache-2.0
import sys
import threading
import time
from pathlib import Path

import numpy as np
from graphs import values
from joint_frames import frame_of
from recordings import START
from std_srvs.srv import Trigger

from soliton_linkage_nodes.chain_identifier.node import ChainIdentifier
from soliton_linkage_nodes.messages.chain_source import chain_of_file
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_from_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces

sys.path.append(str(Path(__file__).parents[2] / 'physics'))

from passages import SPINNER, passage, read, unequal

PERIOD = 4 * 10**6


def test_an_identified_chain_is_published_and_saved(graph, tmp_path):
    path = tmp_path / 'chain.yaml'
    made = unequal(SPINNER, 4)
    named = NamedChain(made, default_joint_names(10))
    node = graph.start(ChainIdentifier, {'interval': 0.0, 'output': str(path)})
    results = graph.hear(interfaces.IDENTIFIED_CHAIN)
    frames = graph.speak(interfaces.JOINT_STATES)
    early = graph.call(Trigger, '/chain_identifier/save')
    assert (early.success, early.message) == (False, 'no chain is identified yet; call ~/identify')
    for number, angles in enumerate(read(passage(made, 400), 1)[0]):
        frames.publish(frame_of(named, angles, START + number * PERIOD))
    graph.until(lambda: node.frames == 400, 'all frames', lambda: node.frames)
    assert graph.call(Trigger, '/chain_identifier/identify').success
    graph.until(lambda: results, 'a result')
    found = chain_from_msg(results[0])
    np.testing.assert_allclose(
        found.chain.rotor_lengths[1:-1] / found.chain.spacings.mean(),
        made.rotor_lengths[1:-1] / made.spacings.mean(),
        rtol=0.08,
    )
    assert graph.call(Trigger, '/chain_identifier/save').success
    saved = chain_of_file(path)
    np.testing.assert_allclose(saved.chain.rest_lengths, found.chain.rest_lengths, rtol=1e-5)
    np.testing.assert_allclose(saved.encoder_offsets, found.encoder_offsets, atol=1e-5)
    assert graph.call(Trigger, '/chain_identifier/forget').success
    assert node.frames == 0


def test_a_running_identification_reports_its_duration(graph, monkeypatch):
    finish = threading.Event()

    def identify(*_, **__):
        finish.wait()
        raise ValueError('no soliton has passed')

    monkeypatch.setattr('soliton_linkage_nodes.chain_identifier.node.identify', identify)
    named = NamedChain(SPINNER, default_joint_names(SPINNER.number_of_rotors))
    node = graph.start(ChainIdentifier, {'interval': 0.0})
    frames = graph.speak(interfaces.JOINT_STATES)
    for number in range(2):
        frames.publish(frame_of(named, SPINNER.uniform_state(1), START + number * PERIOD))
    graph.until(lambda: node.frames == 2, 'the frames', lambda: node.frames)
    begun = time.monotonic()
    assert graph.call(Trigger, '/chain_identifier/identify').success
    first, second = (
        float(values(graph.next_report('chain_identifier'))['identifying for [s]'])
        for _ in range(2)
    )
    assert 0 <= first < second <= time.monotonic() - begun
    finish.set()
    reports = graph.reports('chain_identifier')
    graph.until(
        lambda: reports and values(reports[-1])['identifying'] == 'False',
        'the end',
        lambda: reports,
    )
    assert 'identifying for [s]' not in values(reports[-1])
