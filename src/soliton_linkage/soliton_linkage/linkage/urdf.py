# SPDX-License-Identifier: Apache-2.0
"""Description of a chain in the Unified Robot Description Format (URDF).

A URDF describes a tree of rigid bodies, without springs. The position of each joint is the angle
phi, as in `joint_states`, for even and odd rotors alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

from soliton_linkage.colours import BLUE, DARK, GREY, PALE, shares
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import CheckedQuantities, document_fields, quantity

BASE = 'linkage'
"""Name of the fixed link; the pivots are on its x axis."""
_THICKNESS = 1 / 12
"""Diameter of a rod, relative to the smaller of rotor length and spacing [1]."""
_POINT = 1e-6
"""Moment of inertia of a mass about its centre, relative to its moment about the pivot [1]. The
value is not 0, because many programs reject a moment of inertia of 0."""


@document_fields
@dataclass(frozen=True)
class JointLimits(CheckedQuantities):
    """Limits of the torque and of the rate of each rotor; the angle has no limits."""

    torque: float = quantity(0.1, 'largest torque on a rotor', 'N m', 0.0, 1e6)
    speed: float = quantity(100.0, 'largest rate of a rotor', 'rad/s', 0.0, 1e6)


def robot_description(
    chain: Chain, joint_names: Sequence[str] = (), limits: JointLimits | None = None
) -> str:
    """Return the URDF of a chain, with one continuous joint about the +y axis for each rotor.

    By default the joint names are `rotor_0`, `rotor_1` and so on. A joint named J moves the link
    `J_link`. In the frame of this link, the mass is at (0, 0, r). Raises ValueError unless each
    rotor has its own name.
    """
    rotors = chain.number_of_rotors
    names = list(joint_names) or [f'rotor_{rotor}' for rotor in range(rotors)]
    if len(set(names)) != rotors:
        raise ValueError(
            f'{len(set(names))} distinct names of joints do not fit a chain of {rotors} rotors; '
            'give one per rotor'
        )
    robot = Xml.Element('robot', name='soliton_linkage')
    # MuJoCo shows visual elements only if this tag is present. Other programs ignore the tag.
    Xml.SubElement(Xml.SubElement(robot, 'mujoco'), 'compiler', discardvisual='false')
    for name, colour in (('rod', DARK), ('odd_rod', GREY), ('mass', BLUE), ('base', PALE)):
        material = Xml.SubElement(robot, 'material', name=name)
        rgba = ' '.join(f'{share:.4g}' for share in (*shares(colour), 1))
        Xml.SubElement(material, 'color', rgba=rgba)
    width = _THICKNESS * min(chain.spacing, chain.rotor_length)
    base = Xml.SubElement(robot, 'link', name=BASE)
    size = _row(chain.pivots[-1] + chain.spacing, width / 2, width)
    _add_visual(base, (chain.pivots[-1] / 2, width, 0), 'base', 'box', size=size)
    for rotor, name in enumerate(names):
        _add_link(robot, chain, rotor, name, width)
        _add_joint(robot, chain, rotor, name, limits or JointLimits())
    Xml.indent(robot)
    return Xml.tostring(robot, encoding='unicode')


def link_name(joint: str) -> str:
    """Return the name of the link that a joint moves; the frame of the link has the same name."""
    return f'{joint}_link'


def _add_link(robot: Xml.Element, chain: Chain, rotor: int, joint: str, width: float) -> None:
    length, moment = chain.rotor_lengths[rotor], _POINT * chain.moments_of_inertia[rotor]
    link = Xml.SubElement(robot, 'link', name=link_name(joint))
    inertial = Xml.SubElement(link, 'inertial')
    Xml.SubElement(inertial, 'origin', xyz=_row(0, 0, length), rpy='0 0 0')
    Xml.SubElement(inertial, 'mass', value=_number(chain.masses[rotor]))
    moments = dict.fromkeys(('ixx', 'iyy', 'izz'), _number(moment))
    Xml.SubElement(inertial, 'inertia', moments, ixy='0', ixz='0', iyz='0')
    rod = 'odd_rod' if rotor % 2 else 'rod'
    sizes = {'radius': _number(width / 2), 'length': _number(length)}
    _add_visual(link, (0, 0, length / 2), rod, 'cylinder', **sizes)
    _add_visual(link, (0, 0, length), 'mass', 'sphere', radius=_number(width))


def _add_joint(
    robot: Xml.Element, chain: Chain, rotor: int, name: str, limits: JointLimits
) -> None:
    joint = Xml.SubElement(robot, 'joint', name=name, type='continuous')
    Xml.SubElement(joint, 'origin', xyz=_row(chain.pivots[rotor], 0, 0), rpy='0 0 0')
    Xml.SubElement(joint, 'parent', link=BASE)
    Xml.SubElement(joint, 'child', link=link_name(name))
    Xml.SubElement(joint, 'axis', xyz='0 1 0')
    Xml.SubElement(joint, 'limit', effort=_number(limits.torque), velocity=_number(limits.speed))
    Xml.SubElement(joint, 'dynamics', damping=_number(chain.dampings[rotor]), friction='0')


def _add_visual(
    link: Xml.Element, place: tuple[float, float, float], material: str, shape: str, **sizes: str
) -> None:
    visual = Xml.SubElement(link, 'visual')
    Xml.SubElement(visual, 'origin', xyz=_row(*place), rpy='0 0 0')
    Xml.SubElement(Xml.SubElement(visual, 'geometry'), shape, sizes)
    Xml.SubElement(visual, 'material', name=material)


def _row(*values: float) -> str:
    return ' '.join(map(_number, values))


def _number(value: float) -> str:
    return repr(float(value))
