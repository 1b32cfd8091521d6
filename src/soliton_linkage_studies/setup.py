# SPDX-License-Identifier: Apache-2.0
"""Build of soliton_linkage_studies: by pip, or by colcon as an ament_python package."""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

HOME = Path(__file__).resolve().parent
PACKAGE = 'soliton_linkage_studies'
STUDIES = [
    'accuracy',
    'active',
    'camera',
    'collisions',
    'driving',
    'figures',
    'films',
    'sweep',
    'waves',
]
SETTINGS = [str(path.relative_to(HOME)) for path in sorted(HOME.glob('settings/*.yaml'))]

# pip builds in the source tree. The files of the build go to a temporary folder instead, which
# is deleted when this program exits.
SCRATCH = tempfile.TemporaryDirectory()
OPTIONS = {'build': {'build_base': SCRATCH.name}, 'egg_info': {'egg_base': SCRATCH.name}}

setup(
    name=PACKAGE,
    version=ElementTree.parse(HOME / 'package.xml').findtext('version'),
    description='Figures, films, sweeps and accuracy studies of a topological rotor linkage',
    maintainer='soliton_linkage maintainers',
    maintainer_email='maintainers@soliton-linkage.example',
    license='Apache-2.0',
    license_files=['LICENSE'],
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/settings', SETTINGS),
    ],
    install_requires=[
        'matplotlib>=3.6',
        'numpy>=1.26',
        'pyyaml',
        'scipy>=1.11',
        'soliton_linkage',
    ],
    extras_require={
        'camera': ['soliton_linkage[camera]'],
        'cluster': ['distributed'],
        'films': ['av'],
    },
    entry_points={
        'soliton_linkage.commands': [
            f'moves = {PACKAGE}.moves:main',
            *(f'{name} = {PACKAGE}.{name}.program:main' for name in STUDIES),
        ]
    },
    zip_safe=False,
    options={} if 'sdist' in sys.argv else OPTIONS,
)
