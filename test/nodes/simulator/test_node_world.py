# SPDX-License-Identifier: Apache-2.0
"""Topics, services and parameters of the simulator agree with its physics."""

import dataclasses
import math

import numpy as np
import pytest
from graphs import values
from sensor_msgs.msg import JointState
from simulated_streams import CHAIN, RATE, ROTORS, Paused
from std_msgs.msg import Float64

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import State, leaning, with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.deviations import Disorder
from soliton_linkage.linkage.encoders import EncoderErrors, Encoders
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.solitons.passage import find_obstacles
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.runtime import interfaces


def assert_shown(frames: list[JointState], simulation: Simulation) -> None:
    """Assert that frames equal a simulation, from its current frame on."""
    for frame in frames:
        assert list(frame.position) == simulation.angles.tolist()
        assert list(frame.velocity) == simulation.rates.tolist()
        assert list(frame.effort) == simulation.link_torques.tolist()
        simulation.advance()


@pytest.mark.parametrize(
    ('mechanics', 'kind'), [('elastic', ElasticSimulation), ('rigid', RigidSimulation)]
)
def test_mechanics_gravity_and_damping_are_those_of_the_parameters(graph, mechanics, kind):
    parameters = {
        'mechanics': mechanics,
        'chain.damping': 1e-4,
        'gravity.acceleration': 9.81,
        'gravity.tilt': 0.3,
    }
    paused = Paused(graph, parameters)
    assert paused.reset().success
    chain = dataclasses.replace(CHAIN, damping=1e-4)
    state = leaning(chain, -1)
    twin = kind(chain, state.angles, state.rates, 1 / RATE, gravity=Gravity(9.81, 0.3))
    assert_shown(paused.taken(60), twin)
    assert float(values(graph.next_report('simulator'))['dissipated [J]']) > 0


def test_the_tilt_turns_by_topic_and_by_parameter_at_the_instant_of_a_frame(graph):
    paused = Paused(graph, {'gravity.acceleration': 9.81})
    tilts = graph.speak(interfaces.TILT)
    twin = ElasticSimulation(CHAIN, CHAIN.uniform_state(-1), None, 1 / RATE, 1e-11, Gravity(9.81))
    paused.reset()
    assert_shown(paused.taken(20), twin)
    tilts.publish(Float64(data=0.4))
    node = paused.node
    graph.until(lambda: node.get_parameter('gravity.tilt').value == 0.4, 'the tilt')
    first = paused.taken(1)
    assert list(first[0].position) == twin.angles.tolist()
    twin.set_gravity(Gravity(9.81, 0.4))
    twin.advance()
    assert_shown(paused.taken(20), twin)
    assert paused.change(gravity__tilt=-0.2, gravity__acceleration=5.0).successful
    assert_shown(paused.taken(1), twin)


def test_motors_change_at_the_instant_of_a_frame_and_the_chain_is_published_again(graph):
    heard = graph.hear(interfaces.CHAIN)
    paused = Paused(graph, {'chain.non_reciprocity': 1e-5})
    active = dataclasses.replace(CHAIN, non_reciprocity=1e-5)
    state = leaning(active, -1)
    twin = ElasticSimulation(active, state.angles, state.rates, 1 / RATE)
    paused.reset()
    assert_shown(paused.taken(5), twin)
    assert paused.change(chain__non_reciprocity=-2e-5).successful
    (frame,) = paused.taken(1)
    assert list(frame.position) == twin.angles.tolist()
    twin.set_non_reciprocity(-2e-5)
    twin.advance()
    assert_shown(paused.taken(20), twin)
    graph.until(lambda: heard and heard[-1].non_reciprocity == -2e-5, 'the chain')
    assert not paused.change(chain__non_reciprocity=1e9).successful
    assert not paused.change(chain__damping=1e-5).successful


def test_a_tilt_that_is_no_angle_is_rejected(graph):
    paused = Paused(graph, {'gravity.acceleration': 9.81, 'gravity.tilt': 0.1})
    reports = graph.reports('simulator')
    graph.speak(interfaces.TILT).publish(Float64(data=float('nan')))
    graph.until(lambda: reports and values(reports[-1])['rejected'] == '1', 'the refusal')
    assert 'gravity.tilt = nan must be a finite number' in values(reports[-1])['last rejection']
    assert values(reports[-1])['tilt [rad]'] == '0.1'
    assert paused.node.get_parameter('gravity.tilt').value == 0.1


def test_a_random_chain_is_published_exactly_with_a_warning(graph):
    spread = {'rotor_length': 0.1, 'rest_length': 0.1, 'mass': 0.1, 'damping': 0.2, 'seed': 1}
    parameters = {f'chain.disorder.{name}': value for name, value in spread.items()}
    parameters |= {'chain.damping': 1e-5, 'chain.deviations.stiffness': [0.1] * (ROTORS - 1)}
    paused = Paused(graph, parameters)
    drawn = Disorder(**spread).drawn(ROTORS)
    expected = dataclasses.replace(drawn, stiffness=(0.1,) * (ROTORS - 1))
    assert paused.chain == dataclasses.replace(CHAIN, damping=1e-5, deviations=expected)
    paused.reset()
    state = leaning(paused.chain, -1)
    assert_shown(
        paused.taken(5), ElasticSimulation(paused.chain, state.angles, state.rates, 1 / RATE)
    )
    figures = values(graph.next_report('simulator'))
    obstacles = len(find_obstacles(paused.chain))
    assert int(figures['bonds that may stop a soliton']) == obstacles > 0


def test_periodic_ends_and_fixed_rotors(graph):
    paused = Paused(graph, {'chain.periodic': True, 'fixed_rotors': ['rotor_2', '5']})
    assert paused.chain == dataclasses.replace(CHAIN, periodic=True)
    state = State(CHAIN.uniform_state(-1) + 0.1, np.zeros(ROTORS))
    names = [f'rotor_{rotor}' for rotor in range(ROTORS)]
    response = paused.reset(state=Reset.Request.ANGLES, name=names, angle=list(state.angles))
    assert response.success
    twin = ElasticSimulation(paused.chain, state.angles, None, 1 / RATE, fixed=(2, 5))
    frames = paused.taken(30)
    assert_shown(frames, twin)
    assert frames[-1].position[2] == state.angles[2]


@pytest.mark.parametrize('velocity', [0.5, -0.5])
def test_a_reset_to_a_soliton_and_to_angles_by_name(graph, velocity):
    paused = Paused(graph)
    response = paused.reset(state=Reset.Request.SOLITON, rotor=3.2, velocity=velocity)
    assert (response.success, response.message) == (
        True,
        f'soliton at rotor 3.2 with {velocity} m/s',
    )
    state = with_soliton(CHAIN, 3.2, velocity)
    twin = ElasticSimulation(CHAIN, state.angles, state.rates, 1 / RATE)
    assert_shown(paused.taken(30), twin)
    response = paused.reset(
        state=Reset.Request.ANGLES, name=['rotor_7', 'rotor_0'], angle=[1.0, 2.0], rate=[3.0, 4.0]
    )
    assert (response.success, response.message) == (True, '2 joints at their angles')
    angles = twin.angles.copy()
    angles[[7, 0]] = 1.0, 2.0
    rates = np.zeros(ROTORS)
    rates[[7, 0]] = 3.0, 4.0
    assert_shown(paused.taken(30), ElasticSimulation(CHAIN, angles, rates, 1 / RATE))


def test_an_impossible_reset_changes_nothing(graph):
    paused = Paused(graph, {'mechanics': 'rigid'})
    paused.reset(state=Reset.Request.SOLITON, rotor=3.0, velocity=0.5)
    for request_, complaint in (
        ({'state': Reset.Request.SOLITON, 'rotor': 7.5}, 'site = 7.5 must lie in the range 0 to'),
        (
            {'state': Reset.Request.SOLITON, 'rotor': 3.0, 'velocity': float('inf')},
            'velocity of the soliton = inf m/s must be a finite number',
        ),
        (
            {'state': Reset.Request.SOLITON, 'rotor': 3.0, 'velocity': 1e300},
            'gives an energy that is not finite; start with smaller rates',
        ),
        (
            {'state': Reset.Request.ANGLES, 'name': ['rotor_8'], 'angle': [0.0]},
            "'rotor_8', which is none of 'rotor_0' to 'rotor_7'",
        ),
        (
            {'state': Reset.Request.ANGLES, 'name': ['rotor_1'], 'angle': [0.0]},
            'start from angles that the bars allow',
        ),
        ({'state': 7}, 'state = 7 must be one of 0 to 4'),
    ):
        response = paused.reset(**request_)
        assert not response.success
        assert complaint in response.message
    state = with_soliton(CHAIN, 3.0, 0.5)
    assert_shown(paused.taken(10), RigidSimulation(CHAIN, state.angles, state.rates, 1 / RATE))


def test_joint_states_equal_the_sensor_model(graph):
    errors = EncoderErrors(noise=0.02, quantisation=0.003, offsets=(0.1,) * ROTORS, seed=9)
    given = {
        'sensors.noise': 0.02,
        'sensors.quantisation': 0.003,
        'sensors.offsets': [0.1] * ROTORS,
        'sensors.seed': 9,
        'missing_joints': ['rotor_3', '6'],
    }
    paused = Paused(graph, given)
    paused.reset(state=Reset.Request.SOLITON, rotor=3.2, velocity=0.5)
    start = paused.node.control.status.frames
    frames = paused.taken(30)
    state = with_soliton(CHAIN, 3.2, 0.5)
    twin = ElasticSimulation(CHAIN, state.angles, state.rates, 1 / RATE)
    encoders = Encoders(ROTORS, 1 / RATE, errors)
    shown = [0, 1, 2, 4, 5, 7]
    for number, frame in enumerate(frames, start):
        readings, rates = encoders.read(number, twin.angles)
        assert frame.name == [f'rotor_{rotor}' for rotor in shown]
        assert list(frame.position) == readings[shown].tolist()
        assert list(frame.velocity) == rates[shown].tolist()
        twin.advance()
    assert paused.change(sensors__noise=0.0, sensors__quantisation=0.0).successful
    (frame,) = paused.taken(1)
    assert list(frame.position) == (twin.angles + 0.1)[shown].tolist()


def test_the_real_time_factor_sets_the_rate_of_the_loop_and_is_reported(graph):
    clocks = graph.hear(interfaces.CLOCK)
    paused = Paused(graph, {'real_time_factor': 0.0, 'publish_clock': True})
    loop, control = paused.node.loop, paused.node.control
    assert loop.rate == math.inf
    paused.pause(False)
    before = control.status.frames
    reports = graph.reports('simulator')
    graph.until(lambda: control.status.frames > before + 500, '500 frames')
    paused.pause()
    # While frames follow each other without a pause, they can delay reports in this process.
    graph.until(
        lambda: any(float(values(each).get('real-time factor', 0)) > 0 for each in reports),
        'a report of the rate',
    )
    stopped = control.status.frames
    assert paused.change(real_time_factor=0.5).successful
    assert loop.rate == 0.5 * paused.node.settings.publish_rate
    graph.next_report('simulator')
    assert control.status.frames == stopped
    paused.pause(False)
    graph.until(lambda: control.status.frames > stopped + 60, '60 frames')
    stamps = [clock.clock.sec * 10**9 + clock.clock.nanosec for clock in clocks]
    assert stamps == sorted(set(stamps))


def test_only_the_valid_commands_of_a_flood_are_executed(graph):
    paused = Paused(graph, {'command_timeout': 0.0})
    paused.reset()
    control = paused.node.control
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    names = [f'rotor_{rotor}' for rotor in range(ROTORS)]
    kick, push = np.linspace(1e-6, 2e-6, ROTORS), np.linspace(-1e-3, 1e-3, ROTORS)
    right = 0
    for burst in range(10):
        for _ in range(8):
            impulses.publish(RotorImpulses(name=names, impulse=list(kick)))
            impulses.publish(RotorImpulses(name=names, impulse=[float('nan')] * ROTORS))
            impulses.publish(RotorImpulses(name=['rotor_9'], impulse=[1e-6]))
            impulses.publish(RotorImpulses(name=['rotor_1'], impulse=[0.2]))
            torques.publish(JointState(name=names, effort=list(push * burst)))
            torques.publish(JointState(name=names, effort=[1.0]))
            right += 1
        expected = 2 * right
        graph.until(lambda n=expected: control.status.pending == n, f'{expected} commands')
    refusals = paused.node.diagnostics
    graph.until(lambda: refusals.rejected == 4 * right, 'the refusals')
    reports = graph.reports('simulator')
    torques.publish(JointState(name=['rotor_1'], effort=[10.5]))
    complaint = 'rotor_1 = 10.5 must lie in the range -10 to 10'
    graph.until(lambda: any(complaint in report.message for report in reports), 'the refusal')
    assert complaint in values(reports[-1])['last rejection']
    frames = paused.taken(60)
    twin = ElasticSimulation(CHAIN, CHAIN.uniform_state(-1), None, 1 / RATE)
    assert list(frames[0].position) == twin.angles.tolist()
    for _ in range(right):
        twin.kick(kick)
    twin.hold(push * 9)
    twin.advance()
    assert_shown(frames[1:], twin)


def test_a_pace_of_next_to_nothing_stands_still_and_can_be_left(graph):
    paused = Paused(graph)
    paused.pause(False)
    assert paused.change(real_time_factor=5e-324).successful
    graph.next_report('simulator')
    graph.next_report('simulator')
    standing = paused.node.control.status.frames
    graph.next_report('simulator')
    assert paused.node.control.status.frames == standing
    assert paused.change(real_time_factor=1.0).successful
    graph.until(lambda: paused.node.control.status.frames > standing + 10, 'frames')
    assert paused.node.failure is None
