# SPDX-License-Identifier: Apache-2.0
"""Laws of the URDF: read back by others, it has the places, masses and names of the chain."""

import dataclasses

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, chain_of
from deviating_chains import deviating
from scipy.spatial.transform import Rotation
from urdf_parser_py.urdf import URDF

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.urdf import BASE, JointLimits, robot_description

PRECISION = 1e-12


CHAIN = chain_of(FLIPPER, 7)
UNEQUAL = deviating(dataclasses.replace(CHAIN, damping=1e-5), 3, 0.1)
CHAINS = [*(chain_of(example, 7) for example in EXAMPLES), UNEQUAL]


def angles_of(chain: Chain) -> Array:
    """Angles of some turns, as spinners have them."""
    return np.random.default_rng(19).uniform(-20, 20, chain.number_of_rotors)


def places(robot: URDF, angles: dict[str, float]) -> dict[str, Array]:
    """Place of the centre of mass of each link but the base, by the name of its joint [m]."""
    found = {}
    for joint in robot.joints:
        assert (joint.parent, joint.type) == (BASE, 'continuous')
        assert joint.origin.rpy == [0, 0, 0]
        centre = np.array(robot.link_map[joint.child].inertial.origin.xyz)
        rotation = Rotation.from_rotvec(angles[joint.name] * np.array(joint.axis))
        found[joint.name] = np.array(joint.origin.xyz) + rotation.apply(centre)
    return found


def test_forward_kinematics_are_the_positions_of_the_chain():
    for chain in CHAINS:
        robot = URDF.from_xml_string(robot_description(chain))
        angles = angles_of(chain)
        names = [f'rotor_{rotor}' for rotor in range(chain.number_of_rotors)]
        found = places(robot, dict(zip(names, angles, strict=True)))
        horizontal, vertical = chain.positions(angles)
        expected = np.array([chain.pivots + horizontal, 0 * vertical, vertical]).T
        np.testing.assert_allclose([found[name] for name in names], expected, atol=PRECISION)


def test_masses_moments_and_damping_are_those_of_the_rotors():
    for chain in CHAINS:
        robot = URDF.from_xml_string(robot_description(chain))
        inertials = [robot.link_map[joint.child].inertial for joint in robot.joints]
        masses = [inertial.mass for inertial in inertials]
        moments = [i.inertia.iyy + i.mass * i.origin.xyz[2] ** 2 for i in inertials]
        assert masses == chain.masses.tolist()
        np.testing.assert_allclose(moments, chain.moments_of_inertia, rtol=2e-6)
        assert min(inertial.inertia.ixx for inertial in inertials) > 0
        assert [joint.dynamics.damping for joint in robot.joints] == chain.dampings.tolist()


def test_joints_have_the_names_and_limits_that_are_given():
    names = [f'encoder {rotor}' for rotor in range(CHAIN.number_of_rotors)]
    text = robot_description(CHAIN, names, JointLimits(torque=0.25, speed=30.0))
    robot = URDF.from_xml_string(text)
    assert [joint.name for joint in robot.joints] == names
    assert {(joint.limit.effort, joint.limit.velocity) for joint in robot.joints} == {(0.25, 30.0)}
    assert robot.get_root() == BASE


def test_names_that_do_not_fit_are_rejected():
    for names in [['one'], ['same'] * CHAIN.number_of_rotors]:
        with pytest.raises(ValueError, match='give one per rotor'):
            robot_description(CHAIN, names)


@pytest.mark.parametrize('chain', CHAINS)
def test_tendons_of_mujoco_pull_as_the_springs_do(chain):
    mujoco = pytest.importorskip('mujoco', reason='needs MuJoCo: pip install mujoco')
    specification = mujoco.MjSpec.from_string(robot_description(chain))
    for rotor, length in enumerate(chain.rotor_lengths):
        body = specification.body(f'rotor_{rotor}_link')
        body.add_site(name=f'mass_{rotor}', pos=[0, 0, length])
    for spring, (stiffness, length) in enumerate(
        zip(chain.stiffnesses, chain.rest_lengths, strict=True)
    ):
        tendon = specification.add_tendon(springlength=[length, length])
        tendon.stiffness[0] = stiffness
        tendon.wrap_site(f'mass_{spring}')
        tendon.wrap_site(f'mass_{spring + 1}')
    model = specification.compile()
    assert model.ngeom == 2 * chain.number_of_rotors + 1
    data = mujoco.MjData(model)
    data.qpos[:] = angles = angles_of(chain)
    mujoco.mj_forward(model, data)
    expected = chain.spring_torques(angles)
    np.testing.assert_allclose(data.qfrc_passive, expected, atol=1e-13 * np.abs(expected).max())
