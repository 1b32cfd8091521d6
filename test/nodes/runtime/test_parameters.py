# SPDX-License-Identifier: Apache-2.0
"""Parameters are the dataclasses' fields: described, bounded, checked, and no others."""

import dataclasses
import math
import re
from dataclasses import dataclass, fields
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import Graph
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParameters

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes import start
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.chain_source import CHAIN_PARAMETERS
from soliton_linkage_nodes.programs.experiment.filmed_experiment import FilmedExperimentParameters
from soliton_linkage_nodes.programs.experiment.observer import ExperimentParameters
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import current, declare, reject_unknown
from soliton_linkage_nodes.simulator.node import Simulator

CONFIG = Path(__file__).parents[3] / 'config'
PROGRAMS = {'experiment': ExperimentParameters, 'filmed_experiment': FilmedExperimentParameters}
"""Programs with a section of their own in a parameter file."""


@dataclass(frozen=True)
class Examples:
    """One field of each kind."""

    rate: float = quantity(5.0, 'rate of something', 'Hz', 1.0, 10.0)
    count: int = quantity(3, 'number of things', '', 1, 9)
    lean: str = quantity('left', 'side to lean to', choices=('left', 'right'), adjustable=True)
    name: str = quantity('', 'name of it all')
    loud: bool = quantity(False, 'whether it is loud')
    topics: tuple[str, ...] = quantity((), 'topics of it')
    weights: tuple[float, ...] = quantity((), 'weights of it')
    parts: tuple[str, ...] = quantity((), 'parts of it', adjustable=True)
    gain: float = quantity(1.0, 'gain of it', '', 0.0, adjustable=True)
    hidden: float = 2.0
    """Without a description, and so no parameter."""


class Declarer(GuardedNode):
    def __init__(self, **kwargs: Any) -> None:
        super().__init__('declarer', **kwargs)
        self.settings = declare(self, Examples, 'group.')
        reject_unknown(self)


def change(graph: Graph, **values: Any) -> list[SetParametersResult]:
    """Return what the declarer answers to changes of its parameters."""
    return graph.change('declarer', {f'group.{name}': value for name, value in values.items()})


def section(node: str) -> str:
    """Return the key of a node, or of all nodes, in parameter files."""
    return node if node == '/**' else f'/**/{node}'


def groups(node: str) -> dict[type, str]:
    """Return the dataclasses of a node, or of the chain for all nodes, with their prefixes."""
    if node == '/**':
        return CHAIN_PARAMETERS
    if node in PROGRAMS:
        return {PROGRAMS[node]: ''}
    module, name = getattr(start, node).args
    declared = getattr(import_module(f'soliton_linkage_nodes.{module}'), name).PARAMETERS
    return {kind: prefix for kind, prefix in declared.items() if kind not in CHAIN_PARAMETERS}


def of_node(node: str) -> dict[str, Any]:
    """Return the fields that a node declares, by the name of their parameter."""
    return {
        prefix + field.name: field
        for kind, prefix in groups(node).items()
        for field in fields(kind)
        if 'quantity' in field.metadata
    }


def test_given_values_replace_the_defaults(graph):
    given = {
        'rate': 10.0,
        'count': 1,
        'lean': 'right',
        'name': 'x',
        'loud': True,
        'topics': ['a', 'b'],
        'weights': [0.5, -1.5],
        'parts': ['c'],
        'gain': 1e9,
    }
    node = graph.start(Declarer, {f'group.{name}': value for name, value in given.items()})
    assert node.settings == Examples(
        **{**given, 'topics': ('a', 'b'), 'weights': (0.5, -1.5), 'parts': ('c',)}
    )


def test_an_invalid_value_is_logged_in_one_line(graph):
    for name, value, complaint in [
        ('rate', '5', "= '5' must be a number such as 1.0"),
        ('rate', True, '= True must be a number'),
        ('rate', 11, '= 11.0 must lie in the range 1 to 10 Hz'),
        ('rate', 10.5, '= 10.5 must lie in the range 1 to 10 Hz'),
        ('rate', 10.0000000001, 'must lie in the range 1 to 10 Hz'),
        ('rate', math.nan, '= nan must be a finite number in the range 1 to 10 Hz'),
        ('rate', math.inf, '= inf must be a finite number in the range 1 to 10 Hz'),
        ('gain', math.inf, '= inf must be a finite number of 0 or more'),
        ('gain', -1.0, '= -1.0 must be 0 or more'),
        ('count', 2.0, '= 2.0 must be a whole number such as 20'),
        ('count', 10, '= 10 must lie in the range 1 to 9'),
        ('count', True, '= True must be a whole number'),
        ('lean', 'up', "= 'up' must be one of 'left', 'right'"),
        ('lean', 1, '= 1 must be a text'),
        ('loud', 'yes', "= 'yes' must be true or false"),
        ('topics', 'chain', "= 'chain' must be a list of texts"),
        ('topics', [1, 2], '= [1, 2] must be a list of texts'),
        ('topics', '', "= '' must be a list of texts"),
        ('weights', 1, '= 1 must be a list of numbers such as [1.0, 0.5]'),
        ('weights', ['a'], 'must be a list of numbers such as'),
        ('weights', [True], 'must be a list of numbers such as'),
    ]:
        said = re.escape(f'parameter group.{name} of declarer ') + '.*' + re.escape(complaint)
        with pytest.raises(ValueError, match=said) as refusal:
            graph.start(Declarer, {f'group.{name}': value})
        assert '\n' not in str(refusal.value)


def test_integers_are_accepted_for_floats(graph):
    node = graph.start(Declarer, {'group.rate': 5, 'group.weights': [1, -2]})
    assert node.settings == dataclasses.replace(Examples(), rate=5.0, weights=(1.0, -2.0))
    assert type(node.get_parameter('group.rate').value) is float
    answered = change(graph, gain=3, weights=[2])
    assert [result.successful for result in answered] == [True, False]
    assert 'read-only' in answered[1].reason
    assert type(node.get_parameter('group.gain').value) is float
    described = graph.call(
        DescribeParameters, 'declarer/describe_parameters', names=['group.gain']
    )
    assert described.descriptors[0].type == ParameterType.PARAMETER_DOUBLE


def test_a_list_can_be_emptied(graph):
    node = graph.start(Declarer, {'group.parts': ['a']})
    empty = ParameterValue(type=ParameterType.PARAMETER_BOOL_ARRAY)
    emptied = ParameterMessage(name='group.parts', value=empty)
    answer = graph.call(SetParameters, 'declarer/set_parameters', parameters=[emptied])
    assert answer.results[0].successful
    assert current(node, Examples, 'group.').parts == ()


def test_an_undeclared_parameter_is_rejected_with_a_proposal(graph):
    for name, meant in [
        ('group.rat', "did you mean 'group.rate'?"),
        ('zzz', 'known: group.count, group.gain'),
    ]:
        said = re.escape(f'parameter {name!r} of declarer is unknown; {meant}')
        with pytest.raises(ValueError, match=said):
            graph.start(Declarer, {name: 1.0})


def test_parameters_of_the_chain_and_of_ros_may_be_given_to_every_node(graph):
    node = graph.start(Declarer, {'chain.spacing': 0.2, 'use_sim_time': True})
    assert not node.has_parameter('chain.spacing')


def test_a_change_at_run_time_that_is_not_allowed_changes_nothing(graph):
    for name, value, reason in [
        ('lean', 'up', "parameter group.lean = 'up' must be one of 'left', 'right'"),
        ('gain', math.nan, 'parameter group.gain = nan must be a finite number of 0 or more; set'),
        ('gain', -1, 'parameter group.gain = -1 must be 0 or more; set another value'),
        ('gain', '3', "parameter group.gain = '3' must be a number such as 1.0; set another"),
        ('rate', 2.0, 'read-only while its node runs; start the node with -p group.rate:=2.0'),
    ]:
        node = graph.start(Declarer)
        before = node.get_parameter(f'group.{name}').value
        (result,) = change(graph, **{name: value})
        assert not result.successful
        assert reason in result.reason
        assert node.get_parameter(f'group.{name}').value == before


@pytest.mark.parametrize(
    'create', [Simulator, EdgeActuator, BagRecorder], ids=lambda c: c.__name__
)
def test_nodes_describe_each_parameter_with_unit_range_and_whether_it_can_change(
    graph, create, tmp_path
):
    given = {'output': str(tmp_path / 'bag')} if create is BagRecorder else {}
    name = graph.start(create, given).get_name()
    declared = of_node(name) | (of_node('/**') if create is not BagRecorder else {})
    listed = graph.call(ListParameters, f'{name}/list_parameters')
    of_ros = {'use_sim_time', 'start_type_description_service'}
    assert set(listed.result.names) == declared.keys() | of_ros
    described = graph.call(DescribeParameters, f'{name}/describe_parameters', names=list(declared))
    for parameter, field in zip(described.descriptors, declared.values(), strict=True):
        expected = field.metadata['quantity']
        assert parameter.description.startswith(expected.description)
        assert parameter.description.endswith(f'[{expected.unit}]' if expected.unit else '')
        of_simulator = create is Simulator and parameter.name == 'chain.non_reciprocity'
        assert parameter.read_only == (not (expected.adjustable or of_simulator))
        assert parameter.additional_constraints == ', '.join(expected.choices)
        ranges = [*parameter.floating_point_range, *parameter.integer_range]
        if expected.minimum is not None:
            assert [bounds.from_value for bounds in ranges] == [expected.minimum]
        if expected.maximum is not None:
            assert [bounds.to_value for bounds in ranges] == [expected.maximum]
        assert parameter.type != ParameterType.PARAMETER_NOT_SET


def test_the_configuration_shows_every_parameter_with_its_default():
    sections = yaml.safe_load((CONFIG / 'linkage.yaml').read_text())
    starts = {name: value for name, value in vars(start).items() if isinstance(value, partial)}
    nodes = [name for name, value in starts.items() if len(value.args) > 1]
    for node in ('/**', *nodes, *PROGRAMS):
        shown = sections[section(node)]
        defaults = {name: field.default for name, field in of_node(node).items()}
        assert shown['ros__parameters'] == {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in defaults.items()
        }


def test_configurations_name_known_parameters_only():
    for path in sorted(CONFIG.glob('*.yaml')):
        sections = yaml.safe_load(path.read_text())
        assert list(sections)[-1] == '/**', 'what -p gives must come after the sections of nodes'
        for node, given in sections.items():
            known = of_node(node.removeprefix('/**/'))
            for name, value in given['ros__parameters'].items():
                default = known[name].default
                kind = list if isinstance(default, tuple) else type(default)
                assert isinstance(value, kind), name
                assert known[name].metadata['quantity'].complaint(value) is None, name
