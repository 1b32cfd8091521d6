# SPDX-License-Identifier: Apache-2.0
"""Build of the package soliton_linkage_nodes, by colcon (as an ament_python package) or by pip."""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

HOME = Path(__file__).resolve().parent
PACKAGE = 'soliton_linkage_nodes'
SHARE = f'share/{PACKAGE}'
NODES = [
    *('simulator', 'edge_actuator', 'soliton_analyser', 'soliton_steering', 'chain_identifier'),
    *('bag_recorder', 'bag_player', 'live_view', 'visualisation', 'foxglove_server'),
    *('camera_encoders', 'serial_encoders'),
]
PROGRAMS = [
    *('analyse_bag', 'calibrate_camera', 'check_bag', 'check_rig', 'contraction', 'experiment'),
    *('film_encoders', 'identify_chain', 'live', 'move_soliton', 'nudge', 'print_markers'),
    *('recover_bag', 'robot_description', 'simulated_controller', 'suite', 'watch_soliton'),
]
COMMANDS = [
    *('action', 'bag', 'interface', 'lifecycle', 'node', 'param', 'rig', 'run', 'service', 'topic')
]
# colcon installs programs where `ros2 run` finds them. A wheel would install them on PATH, where
# such general names can conflict with other programs. Therefore a wheel contains none of these
# programs, and `soliton-linkage run` starts them.
EXECUTABLES = [] if {'install', 'develop'}.isdisjoint(sys.argv) else [*NODES, *PROGRAMS]


def files(*patterns):
    """Return pairs of an installation folder under share/ and the list of files for it."""
    found = {}
    for pattern in patterns:
        for path in sorted(HOME.glob(pattern)):
            name = path.relative_to(HOME)
            found.setdefault(f'{SHARE}/{name.parent}', []).append(str(name))
    return list(found.items())


# pip builds in the source tree. A folder that is removed afterwards keeps the tree clean.
SCRATCH = tempfile.TemporaryDirectory()
OPTIONS = {'build': {'build_base': SCRATCH.name}, 'egg_info': {'egg_base': SCRATCH.name}}


setup(
    name=PACKAGE,
    version=ElementTree.parse(HOME / 'package.xml').findtext('version'),
    description='ROS 2 nodes of the topological rotor linkage',
    maintainer='soliton_linkage maintainers',
    maintainer_email='maintainers@soliton-linkage.example',
    license='Apache-2.0',
    license_files=['LICENSE'],
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={
        PACKAGE: [
            'py.typed',
            'live_view/browser/*',
            'live_view/docs/*.md',
            'live_view/docs/pictures/*',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (SHARE, ['package.xml']),
        *files(
            'launch/*.launch.py',
            'config/*.yaml',
            'config/*.xml',
            'config/chains/*.yaml',
            'config/security/*',
            'config/views/*',
            'bags/*.md',
            'bags/*/*',
        ),
    ],
    install_requires=[
        'backports.zstd',
        'lz4',
        'numpy>=1.26',
        'pyyaml',
        'rosbags>=0.11',
        'soliton_linkage',
        'soliton_linkage_studies',
    ],
    extras_require={
        'camera': ['soliton_linkage[camera]'],
        'foxglove': ['foxglove-sdk'],
        'live': ['nicegui>=3'],
        'serial': ['soliton_linkage[serial]'],
    },
    entry_points={
        'console_scripts': [f'{name} = {PACKAGE}.start:{name}' for name in EXECUTABLES],
        'soliton_linkage.commands': [
            f'{name} = {PACKAGE}.commands.{name}:main' for name in COMMANDS
        ],
    },
    zip_safe=False,
    options={} if 'sdist' in sys.argv else OPTIONS,
)
