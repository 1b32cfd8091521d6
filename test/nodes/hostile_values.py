# SPDX-License-Identifier: Apache-2.0
"""Values that parameters may have and messages may bring, corners first, for hypothesis."""

import importlib
import math
import os
import re
from typing import Any, get_args, get_type_hints

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage_msgs.msg import Chain as ChainMessage

# More of them than in CI, and others each time: HOSTILE_EXAMPLES=300 pytest -k hostile
PATIENT = settings(
    max_examples=int(os.environ.get('HOSTILE_EXAMPLES', '6')),
    deadline=None,
    phases=[Phase.generate],
    derandomize='HOSTILE_EXAMPLES' not in os.environ,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
ROTORS = 5
JOINTS = [f'rotor_{rotor}' for rotor in range(ROTORS)]
TEXTS = ['', 'x', 'rotor_0', '/x/y', 'a b', '[', '~', 'ü', 'x' * 300]
BEYOND = [0.0, -0.0, 1.0, -1.0, 5e-324, 1e9, 1e308, -1e308, math.inf, -math.inf, math.nan]
_WHOLE = {'octet': 8, 'byte': 8, 'char': 8} | {f'uint{n}': n for n in (8, 16, 32, 64)}
_SIGNED = {f'int{n}': n for n in (8, 16, 32, 64)}


def within(quantity: Quantity, kind: Any, default: Any) -> SearchStrategy[Any]:
    """Values of the documented range of a parameter."""
    if quantity.choices:
        return st.sampled_from(sorted(quantity.choices))
    low, high = quantity.minimum, quantity.maximum
    if kind is int:
        return st.integers(int(low or 0), int(high or 2**31))
    if kind is str:
        return st.sampled_from([default, *TEXTS])
    if get_args(kind):
        element = get_args(kind)[0]
        usual = '' if element is str else 0.0
        return st.lists(within(quantity, element, usual), max_size=ROTORS).map(tuple)
    if kind is float:
        corners = [default, *(corner for corner in (low, high) if corner is not None)]
        ranged = st.floats(low, high, allow_nan=False, allow_infinity=False)
        return st.one_of(st.sampled_from(corners), ranged)
    return st.booleans() if kind is bool else st.just(default)


@st.composite
def parameters(draw: DrawFn, groups: dict[Any, str], fixed: dict[str, Any]) -> dict[str, Any]:
    """A few parameters of a node anywhere in their ranges, others at defaults, some fixed."""
    chosen = {
        prefix + name: within(described, get_type_hints(group)[name], fields[name].default)
        for group, prefix in groups.items()
        for fields in [group.__dataclass_fields__]
        for name, described in described_fields(group).items()
        if name not in ('autostart', 'real_time')
    }
    names = draw(st.lists(st.sampled_from(sorted(chosen.keys() - fixed.keys())), max_size=4))
    drawn = {name: draw(chosen[name]) for name in names}
    # ROS cannot infer the type of an empty list.
    return {**{name: value for name, value in drawn.items() if value != ()}, **fixed}


@st.composite
def messages(draw: DrawFn, kind: Any) -> Any:
    """A message of a type with values of all kinds, its arrays as long as there are joints."""
    message = kind()
    joints = draw(st.lists(st.sampled_from(JOINTS), unique=True, max_size=ROTORS))
    if draw(st.booleans()):
        joints = JOINTS
    known = described_fields(Chain) if kind is ChainMessage and draw(st.booleans()) else {}
    for name, type_ in kind.get_fields_and_field_types().items():
        if name in known:
            default = Chain.__dataclass_fields__[name].default
            value = draw(within(known[name], type(default), default))
        elif known:
            value = JOINTS if name == 'joint_names' else getattr(message, name)
        else:
            value = draw(_field(type_, joints))
        setattr(message, name, value)
    return message


def _field(type_: str, joints: list[str]) -> SearchStrategy[Any]:
    sequence = re.fullmatch(r'sequence<(.+?)(?:, \d+)?>', type_)
    if sequence and sequence[1] == 'string':
        return st.one_of(
            st.just(joints), st.lists(st.sampled_from([*JOINTS, '', 'x']), max_size=4)
        )
    if sequence:
        element, size = _field(sequence[1], joints), len(joints)
        return st.one_of(
            st.lists(element, min_size=size, max_size=size), st.lists(element, max_size=3)
        )
    if type_ in ('double', 'float'):
        usual = st.floats(-10.0, 10.0)
        return st.one_of(usual, usual, st.sampled_from([v for v in BEYOND if type_ == 'double']))
    if type_ == 'boolean':
        return st.booleans()
    if type_ == 'string':
        return st.sampled_from(['', 'linkage', 'x' * 1000])
    if type_ in _WHOLE:
        return st.one_of(st.integers(0, 10), st.integers(0, 2 ** _WHOLE[type_] - 1))
    if type_ in _SIGNED:
        bits = _SIGNED[type_] - 1
        return st.one_of(st.integers(0, 10), st.integers(-(2**bits), 2**bits - 1))
    package, _, name = type_.partition('/')
    return messages(getattr(importlib.import_module(f'{package}.msg'), name))
