# SPDX-License-Identifier: Apache-2.0
"""Launch files start and stop their nodes with `ros2 launch`, if it is installed."""

import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from graphs import Graph
from programs import PACKAGE

if not shutil.which('ros2'):
    pytest.skip('needs ros2 launch: apt install ros-jazzy-ros2launch', allow_module_level=True)

CHAINS = yaml.safe_load(
    Path(get_package_share_directory(PACKAGE), 'config/chains/three_motions.yaml').read_text()
)
OF_A_CHAIN = ('simulator', 'edge_actuator', 'soliton_analyser', 'soliton_steering')
BEGUN = {
    ('simulate.launch.py', 'record:=run'): {*OF_A_CHAIN, 'bag_recorder', 'visualisation'},
    ('chains.launch.py', 'record:=run', 'bags:=one'): {
        'bag_recorder',
        *(f'{c.strip("/").split("/")[0]}/{n}' for c in CHAINS if c[1] != '*' for n in OF_A_CHAIN),
    },
    ('view.launch.py', 'namespace:=lab'): {'lab/visualisation'},
}
LONGEST_END = 240.0


def begun(graph: Graph) -> set[str]:
    told = graph.user.get_node_names_and_namespaces()
    full = {f'{namespace.rstrip("/")}/{name}'.lstrip('/') for name, namespace in told}
    return {name for name in full - {'user'} if not name.rpartition('/')[2].startswith('_')}


def launch(graph: Graph, folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        ['ros2', 'launch', PACKAGE, *arguments],
        cwd=folder,
        env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


@pytest.mark.parametrize('arguments', BEGUN, ids=lambda arguments: arguments[0])
def test_all_begin_and_end_with_it(graph, tmp_path, arguments):
    launched = launch(graph, tmp_path, *arguments)
    try:
        graph.until(
            lambda: begun(graph) == BEGUN[arguments] or launched.poll() is not None,
            f'{sorted(BEGUN[arguments])}',
            lambda: sorted(begun(graph)),
        )
        # As a terminal does: to all at once.
        os.killpg(launched.pid, signal.SIGINT)
        said, _ = launched.communicate(timeout=LONGEST_END)
    finally:
        if launched.poll() is None:
            os.killpg(launched.pid, signal.SIGKILL)
    assert 'Traceback' not in said
    assert 'process has died' not in said
    if 'record:=run' in arguments:
        assert (tmp_path / 'run_0' / 'metadata.yaml').exists()


def test_a_replay_ends_with_its_bag(graph, tmp_path):
    launched = launch(graph, tmp_path, 'replay.launch.py', 'bag:=flipper_0', 'rate:=50')
    said, _ = launched.communicate(timeout=LONGEST_END)
    assert launched.returncode == 0
    assert 'played' in said
    assert 'Traceback' not in said


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('simulate.launch.py', 'config:=nothing'), 'nothing'),
        (('chains.launch.py', 'bags:=two'), 'bags:=two must be one of each, one'),
        (('chains.launch.py', 'processes:=0'), 'processes:=0 must be a whole number above 0'),
        (('view.launch.py', 'view:=nothing'), 'nothing'),
    ],
    ids=lambda each: each[0],
)
def test_a_wrong_argument_begins_nothing(graph, tmp_path, arguments, complaint):
    launched = launch(graph, tmp_path, *arguments)
    said, _ = launched.communicate(timeout=LONGEST_END)
    assert launched.returncode
    assert complaint in said
    assert 'process started' not in said
