# SPDX-License-Identifier: Apache-2.0
"""The examples run and print results that agree with the physics."""

import json
import math
import re
from pathlib import Path
from typing import Any

import bag_to_pandas
import numpy as np
import own_actuator
import own_encoders
import pytest
import speed_against_kick
import speed_against_rest_angle
from pages import ROOT

from soliton_linkage.actuation import ACTUATORS, EdgeDrive
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand, EdgeLimits
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.continuum import wall_theory

# Other tests of this process look for those that came with the suite.
REGISTERED = ACTUATORS.pop('voice_coil')


def test_a_harder_kick_makes_a_faster_soliton_as_in_theory(capsys):
    speeds = speed_against_kick.main((4.0, 8.0))
    chain = speed_against_kick.CHAIN
    for kick, speed in speeds.items():
        expected = wall_theory(chain).speed_after_kick(chain.rotor_length * kick)
        assert speed == pytest.approx(expected, rel=0.05)
    assert 'theory / c' in capsys.readouterr().out


def test_a_slow_wall_follows_the_arc_of_the_orbit():
    ((speed, slow),) = speed_against_rest_angle.main((0.97,)).values()
    assert speed == pytest.approx(slow, rel=0.01)


def test_a_bag_becomes_columns_of_one_length(capsys):
    columns = bag_to_pandas.main(ROOT / 'bags/flipper_0')
    (length,) = {len(column) for column in columns.values()}
    assert length > 500
    assert np.all(np.diff(columns['time [s]']) > 0)
    place = columns['position [rotor spacings]']
    assert 0 <= place.min() < place.max() <= 19
    assert 'of 20 rotors, a flipper' in capsys.readouterr().out


def test_the_coil_gives_the_torque_of_its_current_at_once():
    assert REGISTERED is own_actuator.VoiceCoil
    coil = own_actuator.VoiceCoil(torque_per_current=0.01)
    drive = EdgeDrive(coil)
    command = EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 0.5, duration=0.1)
    drive.command(command, Edge.FIRST, 1.0)
    assert drive.mean_torque(1.02, 1.03).torque == pytest.approx(0.005)
    assert drive.mean_torque(1.05, 1.15).torque == pytest.approx(0.0025)
    assert drive.mean_torque(1.15, 1.16).torque == pytest.approx(0.0)
    assert not drive.active
    assert coil.torque(coil.pulse_command(1e-3, 0.2)) * 0.2 == pytest.approx(1e-3)
    with pytest.raises(ValueError, match='current = 3 A must be at most 1 A'):
        EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 3.0).check(EdgeLimits(1.0, 1.0), coil)


def test_the_encoders_angles_are_those_of_a_wall_that_the_analyser_follows():
    analyser = Analyser(Chain(own_encoders.ROTORS))
    for frame in range(100, 300):
        time = frame / own_encoders.RATE
        angles = np.array(own_encoders.read_angles(time))
        analysis = analyser.analyse(round(time * 1e9), angles)
        assert analysis is not None
        (soliton,) = analysis.solitons
        assert soliton.rotor == pytest.approx(5 * time, abs=0.5)
    assert math.isclose(soliton.velocity, 0.5, abs_tol=0.05)


def test_the_notebook_runs_cell_by_cell(capsys):
    content = json.loads((ROOT / 'examples/physics.ipynb').read_text(encoding='utf-8'))
    names: dict[str, Any] = {}
    for cell in content['cells']:
        assert not cell.get('outputs')
        if cell['cell_type'] == 'code':
            exec(''.join(cell['source']), names)
    (found,) = re.findall(r'estimated noise: (.*) rad', capsys.readouterr().out)
    assert float(found) == pytest.approx(0.02, rel=0.1)


def test_every_example_is_on_the_page_of_tutorials():
    page = (ROOT / 'docs/tutorials/index.md').read_text(encoding='utf-8')
    for path in sorted(Path(ROOT / 'examples').iterdir()):
        if path.suffix in ('.py', '.ipynb'):
            assert f'../../examples/{path.name}>' in page, path.name
