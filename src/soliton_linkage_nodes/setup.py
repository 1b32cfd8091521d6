# SPDX-License-Identifier: Apache-2.0
"""Build of soliton_linkage_nodes as an ament_python package."""

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.install_scripts import install_scripts

NODES = [
    'simulator',
    'edge_actuator',
    'soliton_analyser',
    'soliton_steering',
    'bag_recorder',
    'bag_player',
]
TOOLS = [
    'analyse_bag',
    'check_bag',
    'contraction',
    'experiment',
    'move_soliton',
    'nudge',
    'recover_bag',
    'watch_soliton',
]
LAUNCH_FILES = [str(path) for path in sorted(Path('launch').glob('*.launch.py'))]


class Scripts(install_scripts):
    """Writes scripts that import nothing before signals are handled.

    Those of setuptools look for their entry point first, for longer than Python itself starts.
    """

    def run(self) -> None:
        """Write one for each program."""
        self.outfiles = []
        for name in NODES + TOOLS:
            lines = f'#!{sys.executable}', f'from soliton_linkage_nodes.start import {name}', ''
            self.write_script(name, '\n'.join([*lines, f'{name}()', '']))


setup(
    name='soliton_linkage_nodes',
    version='0.1.0',
    description='ROS 2 nodes of the topological rotor linkage',
    maintainer='soliton_linkage maintainers',
    maintainer_email='maintainers@soliton-linkage.example',
    license='Apache-2.0',
    packages=['soliton_linkage_nodes'],
    package_data={'soliton_linkage_nodes': ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/soliton_linkage_nodes']),
        ('share/soliton_linkage_nodes', ['package.xml']),
        ('share/soliton_linkage_nodes/launch', LAUNCH_FILES),
    ],
    install_requires=['rosbags', 'soliton_linkage'],
    entry_points={
        'console_scripts': [
            f'{name} = soliton_linkage_nodes.start:{name}' for name in NODES + TOOLS
        ],
    },
    cmdclass={'install_scripts': Scripts},
    zip_safe=False,
)
