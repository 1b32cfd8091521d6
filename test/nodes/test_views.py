# SPDX-License-Identifier: Apache-2.0
"""Viewer layouts show existing topics, types, fields and nodes, and miss none."""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import yaml
from std_srvs.srv import SetBool

from soliton_linkage_nodes.messages.fields import interface_type
from soliton_linkage_nodes.runtime.interfaces import DISPLAY_TOPICS, SUITE_TOPICS

VIEWS = Path(__file__).parents[2] / 'config' / 'views'
SOURCES = Path(__file__).parents[2] / 'src' / 'soliton_linkage_nodes' / 'soliton_linkage_nodes'
TOPICS = {f'/{topic.name.lstrip("/")}': topic.type for topic in (*SUITE_TOPICS, *DISPLAY_TOPICS)}
RVIZ_TYPES = {
    'RobotModel': 'String',
    'MarkerArray': 'MarkerArray',
    'PoseWithCovariance': 'PoseWithCovarianceStamped',
    'Image': 'Image',
}
JOINT = re.compile(r'rotor_\d+')
STATUS = re.compile(r'/(\w+)/(\w+): (\w+)/level')
Series = tuple[str, list[str]]
PANELS = {'3D', 'Image', 'Plot', 'DiagnosticSummary', 'Publish', 'CallService'}


def follow(message_type: Any, path: list[str]) -> str:
    """Return the type of a field; a missing one fails the test."""
    types = message_type.get_fields_and_field_types()
    name, index = re.fullmatch(r'(\w+)((?:\[\d+\])?)', path[0]).groups()
    assert name in types, f'{message_type.__name__} has no {name}'
    kind = re.sub(r'^sequence<(.*?)(?:, \d+)?>$|^(.*)\[\d+\]$', r'\1\2', types[name])
    assert bool(index) == (kind != types[name]), f'{name} is {types[name]}'
    if len(path) == 1:
        return kind
    return follow(interface_type(kind, 'msg'), path[1:])


def check(series: Series) -> None:
    """A number of a topic, by the path of its field."""
    topic, path = series
    assert topic in TOPICS, topic
    assert follow(TOPICS[topic], path) in ('double', 'float', 'boolean', 'int8', 'int32', 'uint8')


def foxglove() -> dict[str, Any]:
    held: dict[str, Any] = json.loads((VIEWS / 'foxglove.json').read_text(encoding='utf-8'))
    return held


def leaves(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        assert layout['direction'] in ('row', 'column')
        assert 0 < layout['splitPercentage'] < 100
        yield from leaves(layout['first'])
        yield from leaves(layout['second'])


def foxglove_series() -> list[Series]:
    plots = [held for name, held in foxglove()['configById'].items() if name.startswith('Plot!')]
    paths = [path['value'].partition('.') for plot in plots for path in plot['paths']]
    return [(topic, field.split('.')) for topic, _, field in paths]


def rqt_plugins() -> dict[str, dict[str, Any]]:
    held = json.loads((VIEWS / 'rqt.perspective').read_text(encoding='utf-8'))
    manager = held['groups']['pluginmanager']
    running = ast.literal_eval(manager['keys']['running-plugins']['repr'])
    started = [
        f'plugin__{name.replace("/", "__")}__{serial}'
        for name, serials in running.items()
        for serial in serials
    ]
    assert sorted(started) == sorted(manager['groups'])
    return {
        name: {
            key: ast.literal_eval(value['repr'])
            for key, value in group['groups']['plugin']['keys'].items()
        }
        for name, group in manager['groups'].items()
    }


def rqt_series() -> list[Series]:
    paths = [path for held in rqt_plugins().values() for path in held.get('topics', ())]
    return [(f'/{topic}', rest) for topic, *rest in (path[1:].split('/') for path in paths)]


def curves() -> list[dict[str, str]]:
    return [curve.attrib for curve in Xml.parse(VIEWS / 'plotjuggler.xml').iter('curve')]


def test_plots_of_foxglove_and_rqt_show_numbers_that_there_are():
    for series in [*foxglove_series(), *rqt_series()]:
        check(series)


def test_panels_of_foxglove_show_topics_of_their_type_and_each_is_on_the_page():
    panels = foxglove()['configById']
    assert sorted(leaves(foxglove()['layout'])) == sorted(panels)
    assert {name.partition('!')[0] for name in panels} == PANELS
    space, picture = panels['3D!chain'], panels['Image!kymograph']
    assert space['followTf'] == 'linkage'
    shown = {TOPICS[topic].__name__ for topic in space['topics']}
    assert shown == {'MarkerArray', 'PoseWithCovarianceStamped', 'String'}
    assert TOPICS[picture['imageMode']['imageTopic']].__name__ == 'Image'
    diagnostics = panels['DiagnosticSummary!nodes']['topicToRender']
    assert TOPICS[diagnostics].__name__ == 'DiagnosticArray'
    nudge = panels['Publish!nudge']
    message_type = interface_type(nudge['datatype'], 'msg')
    assert message_type is TOPICS[nudge['topicName']]
    assert message_type(**json.loads(nudge['value'])).data > 0
    pause = panels['CallService!pause']
    assert SetBool.Request(**json.loads(pause['requestPayload'])).data


def test_the_image_of_rqt_is_the_kymograph():
    (view,) = (held for name, held in rqt_plugins().items() if 'ImageView' in name)
    assert TOPICS[view['topic']].__name__ == 'Image'


def test_displays_of_rviz_show_topics_of_their_type_and_durability():
    held = yaml.safe_load((VIEWS / 'linkage.rviz').read_text(encoding='utf-8'))
    manager = held['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'linkage'
    for display in manager['Displays']:
        kind = display['Class'].removeprefix('rviz_default_plugins/')
        topic = display.get('Topic') or display['Description Topic']
        (known,) = (each for each in DISPLAY_TOPICS if f'/{each.name}' == topic['Value'])
        assert known.type.__name__ == RVIZ_TYPES[kind]
        latched = topic['Durability Policy'] == 'Transient Local'
        assert (latched, topic['Reliability Policy']) == (known.latched, 'Reliable')
    assert {d['Class'].partition('/')[2] for d in manager['Displays']} == RVIZ_TYPES.keys()
    drawn = (SOURCES / 'visualisation').glob('*.py')
    text = ''.join(path.read_text(encoding='utf-8') for path in drawn)
    (markers,) = (d for d in manager['Displays'] if d['Class'].endswith('MarkerArray'))
    assert all(f"'{name}'" in text for name in markers['Namespaces'])


def test_curves_of_plotjuggler_show_numbers_that_there_are():
    for curve in curves():
        topic, field = curve['topic'], curve['field']
        assert curve['name'] == topic + field
        path = field[1:].split('/')
        if topic == '/joint_states':
            assert JOINT.fullmatch(path[0])
            check((topic, [f'{path[1]}[0]']))
        elif topic == '/diagnostics':
            space, node, task = STATUS.fullmatch(field[1:]).groups()
            assert space == node
            (name,) = SOURCES.glob(f'{node}/node.py')
            told = re.search(
                r"\bDiagnostics\(\s*self,\s*'(\w+)'", name.read_text(encoding='utf-8')
            )
            assert told
            assert told[1] == task
        else:
            check((topic, path))


def test_layouts_of_plotjuggler_have_valid_splitters_and_one_plot_per_area():
    root = Xml.parse(VIEWS / 'plotjuggler.xml').getroot()
    assert (root.tag, root.get('pj4_version'), root.get('binding')) == ('root', '4', 'generic')
    for splitter in root.iter('DockSplitter'):
        assert splitter.get('orientation') in ('|', '-')
        sizes = str(splitter.get('sizes')).split(';')
        assert len(splitter) == len(sizes) == int(str(splitter.get('count')))
    areas = list(root.iter('DockArea'))
    assert all([each.tag for each in area] == ['plot'] for area in areas)
    assert len({area[0].get('id') for area in areas}) == len(areas)


def test_each_shows_chain_track_phase_energies_and_diagnostics():
    for shown in [
        [f'{topic}/{"/".join(path)}' for topic, path in foxglove_series()]
        + [p['topicToRender'] for p in foxglove()['configById'].values() if 'topicToRender' in p],
        [f'{topic}/{"/".join(path)}' for topic, path in rqt_series()]
        + ['/diagnostics' for name in rqt_plugins() if 'RobotMonitor' in name],
        [curve['name'] for curve in curves()],
    ]:
        for wanted in (
            '/joint_states',
            '/soliton_state/solitons[0]/rotor',
            '/soliton_state/cycle/phase',
            '/soliton_state/energies/kinetic',
            '/soliton_state/energies/elastic',
            '/diagnostics',
        ):
            assert any(name.startswith(wanted) for name in shown), wanted
