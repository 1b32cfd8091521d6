# SPDX-License-Identifier: Apache-2.0
"""Build of soliton_linkage: by pip, or by colcon as an ament_python package."""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

HOME = Path(__file__).resolve().parent
PAPER = 'https://doi.org/10.1073/pnas.1405969111'

# pip builds in the source tree. A folder that is removed afterwards keeps the tree clean.
SCRATCH = tempfile.TemporaryDirectory()
OPTIONS = {'build': {'build_base': SCRATCH.name}, 'egg_info': {'egg_base': SCRATCH.name}}

setup(
    name='soliton_linkage',
    version=ElementTree.parse(HOME / 'package.xml').findtext('version'),
    description='Physics and analysis of a topological rotor linkage',
    long_description=(HOME / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    maintainer='soliton_linkage maintainers',
    maintainer_email='maintainers@soliton-linkage.example',
    license='Apache-2.0',
    license_files=['LICENSE'],
    url=PAPER,
    project_urls={'Paper': PAPER, 'ROS 2': 'https://docs.ros.org/en/jazzy'},
    classifiers=[
        'Intended Audience :: Science/Research',
        'Operating System :: OS Independent',
        'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering :: Physics',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=['soliton_linkage', 'soliton_linkage.*']),
    package_data={'': ['__init__.pyi'], 'soliton_linkage': ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/soliton_linkage']),
        ('share/soliton_linkage', ['package.xml']),
    ],
    install_requires=['numba>=0.58', 'numpy>=1.26', 'scipy>=1.11'],
    extras_require={
        'benchmark': [
            'heyoka; python_version >= "3.11"',
            'mcap',
            'mujoco; python_version >= "3.11"',
        ],
        'camera': ['av', 'matplotlib>=3.6', 'opencv-python-headless>=4.6'],
        'completion': ['argcomplete'],
        'serial': ['pyserial>=3.4'],
    },
    entry_points={'console_scripts': ['soliton-linkage = soliton_linkage.command:main']},
    zip_safe=False,
    options={} if 'sdist' in sys.argv else OPTIONS,
)
