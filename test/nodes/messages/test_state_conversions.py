# SPDX-License-Identifier: Apache-2.0
"""A soliton state reports what the analysis found, in each of its fields."""

import math
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis, CyclePhase
from soliton_linkage.estimation.estimates import AnalysedSoliton, EventKind, TrackingStatus
from soliton_linkage.estimation.motion_class import MotionClass
from soliton_linkage.estimation.state_report import EdgeRotors, Energies, Topology
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage_msgs import msg
from soliton_linkage_msgs.msg import SolitonEvent, SolitonState
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.messages.state_conversions import (
    KINDS,
    NumberFields,
    columns,
    row,
    solitons_from_msg,
    state_to_msg,
)

JOINTS = JointStates(1_700_000_000, 123_456_789, 'somewhere', (), np.zeros(0), np.zeros(0))
NAN = math.nan
NAN_SOLITON = AnalysedSoliton(0, 1.5, 0.15, NAN, NAN, NAN, -1, 1e-3, NAN, NAN)
SOLITON = AnalysedSoliton(7, 3.25, 0.325, -1.0, 0.12, 0.125, 1, 1e-4, 1e-5, 1e-6)


@lru_cache
def wobbling() -> Analysis:
    """A wobbling wall in the middle of its chain, with all quantities known."""
    chain = Chain(number_of_rotors=16, rotor_length=0.12, rest_angle=0.77)
    cycle, analyser = UniformOrbit(chain), Analyser(chain)
    generator = np.random.default_rng(6)
    for number in range(30):
        arc = cycle.arc_at(8.0 + 0.01 * number, 1) + cycle.length
        angles = cycle.configuration(arc) + 1e-3 * generator.standard_normal(16)
        angles[4] = math.nan
        found = analyser.analyse(number * 10**7, angles, np.zeros(16))
    assert found is not None
    assert found.wobble is not None
    return found


def test_an_analysis_has_the_header_of_its_frame_and_its_solitons_come_back():
    for count in [0, 1, 2]:
        solitons = (SOLITON, NAN_SOLITON)[:count]
        message = state_to_msg(wobbling()._replace(solitons=solitons), JOINTS)
        stamp = message.header.stamp
        assert (stamp.sec, stamp.nanosec, message.header.frame_id) == JOINTS[:3]
        back = solitons_from_msg(message)
        assert len(back) == count
        for one, other in zip(back, solitons, strict=True):
            np.testing.assert_array_equal(one, other)


def filled(analysis: Analysis, joints: JointStates) -> SolitonState:
    """A message that is filled field by field, by name."""
    motion, measured = analysis.motion, analysis.measured_motion
    state = SolitonState(
        motion=number_of(motion),
        motion_name=motion.value if motion else 'unknown',
        measured_motion=number_of(measured.motion),
        measured_motion_confidence=measured.confidence,
        status=getattr(SolitonState, analysis.status.name),
        solitons=[named(msg.Soliton(), soliton) for soliton in analysis.solitons],
        cycle=named(msg.Cycle(rotor=analysis.estimate.site), analysis.cycle),
        energies=named(msg.Energies(), analysis.energies),
        noise=analysis.estimate.noise,
        misfit=analysis.estimate.misfit,
        unseen=analysis.unseen,
    )
    fill_topology(state.topology, analysis.topology, analysis.edge_rotors)
    fill_wobble(state.wobble, analysis.wobble)
    state.header.stamp.sec, state.header.stamp.nanosec = joints.seconds, joints.nanoseconds
    state.header.frame_id = joints.frame_id
    return state


def number_of(motion: Motion | None) -> int:
    return int(getattr(SolitonState, motion.name if motion else 'UNKNOWN'))


def named(message: Any, source: Any) -> Any:
    """A message with what a source has under the same names, NaN where there is no source."""
    for name in message.get_fields_and_field_types():
        if source is None or hasattr(source, name):
            setattr(message, name, getattr(source, name, NAN))
    return message


def fill_topology(message: Any, topology: Topology | None, edges: EdgeRotors | None) -> None:
    for name in ('polarisation_before', 'polarisation_beyond', 'zero_mode_rotor'):
        setattr(message, name, NAN)
    message.first_turns = message.last_turns = NAN
    if topology is not None:
        message.winding_before, message.winding_beyond = topology.winding_numbers
        message.polarisation_before, message.polarisation_beyond = topology.polarisations
        message.charge = topology.charge
        message.zero_mode_rotor = topology.mode_centre
    if edges is not None:
        message.first_turns, message.last_turns = edges.turns
        if edges.toggled is not None:
            message.first_toggled, message.last_toggled = edges.toggled


def fill_wobble(message: Any, wobble: Any) -> None:
    named(message, wobble)
    message.amplitude_at_rest = NAN if wobble is None else wobble.rest_amplitude
    message.theory_decay_length = NAN if wobble is None else wobble.exact_decay_length
    message.theory_wavelength = NAN if wobble is None else wobble.exact_wavelength


FLOATS = st.floats()
PAIRS = st.tuples(FLOATS, FLOATS)
SIGNS = st.integers(-1, 1)
NAMES = st.integers(0, 2**32 - 1)
ANALYSES = st.deferred(
    lambda: st.builds(
        wobbling()._replace,
        motion=st.sampled_from([None, *Motion]),
        measured_motion=st.builds(MotionClass, st.sampled_from([None, *Motion]), FLOATS),
        estimate=st.builds(
            wobbling().estimate._replace,
            site=FLOATS,
            status=st.sampled_from(TrackingStatus),
            noise=FLOATS,
            misfit=FLOATS,
        ),
        cycle=st.builds(
            CyclePhase,
            *4 * [FLOATS],
            completed=st.integers(-(2**31), 2**31 - 1),
            leg=st.integers(-1, 3),
        ),
        solitons=st.lists(
            st.builds(AnalysedSoliton, NAMES, *5 * [FLOATS], SIGNS, *3 * [FLOATS]), max_size=4
        ).map(tuple),
        topology=st.none()
        | st.builds(Topology, PAIRS, st.tuples(SIGNS, SIGNS), charge=SIGNS, mode_centre=FLOATS),
        edge_rotors=st.none()
        | st.builds(EdgeRotors, st.none() | st.tuples(st.booleans(), st.booleans()), PAIRS),
        energies=st.none() | st.builds(Energies, *6 * [FLOATS]),
        wobble=st.none()
        | st.builds(
            wobbling().wobble._replace, amplitude=FLOATS, decay_length=FLOATS, wavelength=FLOATS
        ),
        unseen=st.integers(0, 2**32 - 1),
    )
)
HEADERS = st.builds(
    JOINTS._replace,
    seconds=st.integers(-(2**31), 2**31 - 1),
    nanoseconds=st.integers(0, 2**32 - 1),
    frame_id=st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=9),
)


@given(ANALYSES, HEADERS)
def test_every_field_is_filled_by_name(analysis, joints):
    message = state_to_msg(analysis, joints)
    assert repr(message) == repr(filled(analysis, joints))
    assert repr(deserialize_message(serialize_message(message), SolitonState)) == repr(message)


@given(ANALYSES, HEADERS)
def test_a_row_has_a_cell_for_every_column(analysis, joints):
    cells = dict(zip(columns(), row(analysis, joints), strict=True))
    assert cells['stamp [ns]'] == joints.seconds * 10**9 + joints.nanoseconds
    assert cells['solitons'] == len(analysis.solitons)
    np.testing.assert_equal(cells['cycle_phase [rad]'], analysis.cycle.phase)
    energies = analysis.energies
    np.testing.assert_equal(cells['energies_wake [J]'], energies.wake if energies else NAN)
    np.testing.assert_equal(
        cells['soliton_position [m]'], analysis.solitons[0].position if analysis.solitons else NAN
    )
    assert cells['unseen'] == analysis.unseen


def test_a_column_names_its_unit_unless_it_is_a_plain_number():
    cells = dict(zip(columns(), row(wobbling(), JOINTS), strict=True))
    plain = {name for name, cell in cells.items() if isinstance(cell, float) and '[' not in name}
    assert plain == {
        'measured_motion_confidence',
        'topology_polarisation_before',
        'topology_polarisation_beyond',
    }
    assert {name.partition(' [')[2] for name in columns()} == {
        *('', 'ns]', 'm]', 'm/s]', 'rad]', 'rad/s]', 'J]', 'turns]', 'rotor spacings]')
    }


def test_a_new_field_is_filled_by_the_attribute_of_its_name():
    class MarkedSoliton(AnalysedSoliton):
        mark: int = 7

    marked = [*msg.Soliton.get_fields_and_field_types(), 'mark']
    soliton = MarkedSoliton(7, 3.25, 0.325, -1.0, 0.12, 0.125, 1, 1e-4, 1e-5, 1e-6)
    number_fields = NumberFields(marked, MarkedSoliton)
    before = NumberFields(msg.Soliton.get_fields_and_field_types(), AnalysedSoliton)
    assert number_fields(soliton) == (*before(soliton), 7)
    assert number_fields.names[-1] == 'mark'


def test_a_field_without_a_source_is_rejected():
    marked = [*msg.Soliton.get_fields_and_field_types(), 'mark']
    with pytest.raises(TypeError, match='field mark of SolitonState has no source: AnalysedSol'):
        NumberFields(marked, AnalysedSoliton)
    with pytest.raises(TypeError, match='MotionClass has no mark; add the attribute'):
        NumberFields(['mark'], Analysis, {'mark': 'measured_motion.mark'})


def test_each_kind_has_a_number_of_its_own():
    assert sorted(KINDS.values()) == list(range(len(EventKind)))
    assert KINDS[EventKind.PASSING] == SolitonEvent.PASSING
