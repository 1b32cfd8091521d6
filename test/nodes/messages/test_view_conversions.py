# SPDX-License-Identifier: Apache-2.0
import math
import re
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
)

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.msg import EdgeCommand, Soliton, SolitonState
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.live_view.sharing import soliton_numbers
from soliton_linkage_nodes.messages import view_conversions as views

NOTHING = [math.nan, math.inf, -math.inf, '1', None, True, [1.0]]


def test_a_state_becomes_numbers_and_its_walls_a_list():
    message = SolitonState(
        motion=SolitonState.SPINNER,
        solitons=[
            Soliton(rotor=2.5, velocity=-0.5, charge=1, position_deviation=0.01),
            Soliton(rotor=7.5, charge=-1, position_deviation=0.02),
        ],
    )
    message.cycle.phase, message.cycle.leg = 1.5, 1
    message.energies.wake = 0.25
    message.topology.winding_beyond = 1
    numbers = views.state_numbers(message)
    assert (numbers['rotor'], numbers['velocity'], numbers['walls']) == (2.5, -0.5, 2)
    assert (numbers['phase'], numbers['leg'], numbers['wake_energy']) == (1.5, 1, 0.25)
    assert numbers['winding_beyond'] == 1
    assert soliton_numbers(message.solitons) == [2.5, 0.01, 1.0, 7.5, 0.02, -1.0]


def test_without_a_wall_its_numbers_are_nan():
    numbers = views.state_numbers(SolitonState())
    assert numbers['walls'] == 0
    assert all(math.isnan(numbers[name]) for name in ('rotor', 'velocity', 'position_deviation'))


def test_an_edge_command_has_all_that_was_asked_for():
    for edge in ['nearest', 'first', 'last']:
        for kind in ['kick', 'pulse', 'pressure']:
            command = views.edge_command_of(kind, edge, -2.0, 0.5, 0.25, 0.125)
            assert command.kind == getattr(EdgeCommand, kind.upper())
            assert command.edge == getattr(EdgeCommand, edge.upper())
            times = (command.value, command.duration, command.ramp_up, command.ramp_down)
            assert times == (-2.0, 0.5, 0.25, 0.125)


def test_a_waveform_has_its_shape_frequencies_and_cycles():
    for shape in ['burst', 'chirp', 'noise']:
        for quantity in ['torque', 'angle']:
            command = views.edge_command_of(
                *('waveform', 'first', 0.1, 2.0, 0.0, 0.0),
                shape=shape,
                quantity=quantity,
                frequency=30.0,
                last_frequency=40.0,
                cycles=5.0,
            )
            assert command.kind == EdgeCommand.WAVEFORM
            assert command.shape == getattr(EdgeCommand, shape.upper())
            assert command.quantity == getattr(EdgeCommand, quantity.upper())
            assert (command.frequency, command.last_frequency, command.cycles) == (30, 40, 5)
    with pytest.raises(ValueError, match='frequency = inf must be a finite number'):
        views.edge_command_of(*('waveform', 'first', 0.1, 2.0, 0.0, 0.0), frequency=math.inf)


def test_infinite_numbers_are_rejected_everywhere():
    for value in NOTHING:
        for convert in (
            views.number_to_msg,
            lambda v: views.edge_command_of('kick', 'nearest', v, 0.0, 0.0, 0.0),
            lambda v: views.edge_command_of('kick', 'nearest', 0.0, 0.0, 0.0, v),
            lambda v: views.reset_request('soliton', v, 0.0),
            lambda v: views.reset_request('angles', 0.0, 0.0, {'rotor_0': v}),
            lambda v: views.move_goal(v, 0.0),
            views.step_request,
        ):
            with pytest.raises(ValueError, match='must be a'):
                convert(value)


def test_a_step_is_a_whole_number_of_periods():
    for periods in [0, -1, 1.5, 2**32]:
        with pytest.raises(ValueError, match='whole number of 1 or more'):
            views.step_request(periods)
        assert views.step_request(7.0).periods == 7


def test_unknown_names_are_rejected_with_the_known_ones():
    with pytest.raises(ValueError, match="kind = 'push' must be one of kick, pulse, pressure"):
        views.edge_command_of('push', 'nearest', 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="edge = 'left' must be one of nearest, first, last"):
        views.edge_command_of('kick', 'left', 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="state = 'chaos' must be one of initial"):
        views.reset_request('chaos', 0.0, 0.0)


def test_every_state_of_a_reset_and_every_outcome_of_a_move_has_a_word():
    assert set(views.STATES.values()) == set(range(Reset.Request.ANGLES + 1))
    request = views.reset_request('angles', 0.0, 0.0, {'rotor_1': 0.5})
    assert (request.state, request.name, list(request.angle)) == (4, ['rotor_1'], [0.5])
    assert set(views.OUTCOMES) == set(range(MoveSoliton.Result.INVALID_SPEED + 1))


def descriptor(name: str, kind: int, **more: Any) -> ParameterDescriptor:
    return ParameterDescriptor(name=name, type=kind, description=f'{name} of the test', **more)


def test_parameters_that_may_be_changed_come_with_range_and_choices():
    number = ParameterType.PARAMETER_DOUBLE
    ranged = descriptor('gain', number)
    ranged.floating_point_range = [FloatingPointRange(from_value=0.0, to_value=2.0)]
    counted = descriptor('count', ParameterType.PARAMETER_INTEGER)
    counted.integer_range = [IntegerRange(from_value=1, to_value=9, step=1)]
    text = ParameterType.PARAMETER_STRING
    chosen = descriptor('edge', text, additional_constraints='first, last')
    flag = descriptor('loud', ParameterType.PARAMETER_BOOL)
    values = [
        ParameterValue(type=number, double_value=1.5),
        ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=3),
        ParameterValue(type=text, string_value='last'),
        ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=True),
    ]
    gain, count, edge, loud = views.adjustable_parameters([ranged, counted, chosen, flag], values)
    assert (gain.value, gain.range.minimum, gain.range.maximum) == (1.5, 0.0, 2.0)
    assert (count.value, count.range.minimum, count.range.maximum) == (3, 1.0, 9.0)
    assert (edge.value, edge.range.choices) == ('last', ('first', 'last'))
    assert loud.value is True
    assert views.parameter_value(count, 4.0).integer_value == 4
    assert views.parameter_value(gain, '0.5').double_value == 0.5
    for parameter, value, reason in (
        (gain, 'much', "parameter gain = 'much' must be a number such as 1.0; set another value"),
        (gain, None, 'parameter gain = None must be a number such as 1.0; set another value'),
        (count, 4.5, 'parameter count = 4.5 must be a whole number such as 20; set another'),
        (count, 10, 'parameter count = 10 must lie in the range 1 to 9; set another value'),
    ):
        with pytest.raises(ValueError, match=re.escape(reason)):
            views.parameter_value(parameter, value)


def test_read_only_parameters_and_lists_are_not_offered():
    number = ParameterType.PARAMETER_DOUBLE
    assert views.is_adjustable(descriptor('gain', number))
    assert not views.is_adjustable(descriptor('gain', number, read_only=True))
    assert not views.is_adjustable(descriptor('use_sim_time', ParameterType.PARAMETER_BOOL))
    assert not views.is_adjustable(descriptor('gains', ParameterType.PARAMETER_DOUBLE_ARRAY))


def test_reports_have_node_level_and_figures():
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN,
        name='simulator: simulation',
        message='late',
        hardware_id='/left/simulator',
        values=[KeyValue(key='frames', value='7')],
    )
    foreign = DiagnosticStatus(level=DiagnosticStatus.OK, name='camera: images', message='fine')
    first, second = views.reports_from_msg(DiagnosticArray(status=[status, foreign]))
    assert (first.node, first.level, first.message) == ('/left/simulator', 1, 'late')
    assert first.figures == {'frames': '7'}
    assert (second.node, second.level) == ('camera', 0)
