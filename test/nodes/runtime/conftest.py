# SPDX-License-Identifier: Apache-2.0
"""All nodes without optional packages, and the parameters that some of them require."""

import pytest
from recordings import run_of, write_bag

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.chain_identifier.node import ChainIdentifier
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.serial_encoders.node import SerialEncoders
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering


@pytest.fixture(
    params=[
        Simulator,
        EdgeActuator,
        SolitonAnalyser,
        SolitonSteering,
        ChainIdentifier,
        BagRecorder,
        BagPlayer,
        SerialEncoders,
    ],
    ids=lambda node_type: node_type.__name__,
)
def node_type(request):
    return request.param


@pytest.fixture
def needed(named, tmp_path, terminal):
    bag = write_bag(tmp_path / 'bag', run_of(named, 200, gap=10**7))
    return {
        BagRecorder: {'output': str(tmp_path / 'run')},
        BagPlayer: {'bag': str(bag), 'subscriber_timeout': 0.0},
        SerialEncoders: {'port': terminal.path},
    }
