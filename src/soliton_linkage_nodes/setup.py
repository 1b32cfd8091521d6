# SPDX-License-Identifier: Apache-2.0
"""Build of soliton_linkage_nodes as an ament_python package."""

from pathlib import Path

from setuptools import find_packages, setup

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

setup(
    name='soliton_linkage_nodes',
    version='0.1.0',
    description='ROS 2 nodes of the topological rotor linkage',
    maintainer='soliton_linkage maintainers',
    maintainer_email='maintainers@soliton-linkage.example',
    license='Apache-2.0',
    packages=find_packages(include=['soliton_linkage_nodes', 'soliton_linkage_nodes.*']),
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
    zip_safe=False,
)
