# SPDX-License-Identifier: Apache-2.0
"""Build of soliton_linkage as an ament_python package."""

from setuptools import find_packages, setup

STUDIES = ['accuracy', 'driving', 'figures', 'films', 'moves', 'sweep']

setup(
    name='soliton_linkage',
    version='0.1.0',
    description='Physics and analysis of a topological rotor linkage',
    maintainer='soliton_linkage maintainers',
    maintainer_email='maintainers@soliton-linkage.example',
    license='Apache-2.0',
    packages=find_packages(include=['soliton_linkage', 'soliton_linkage.*']),
    package_data={'': ['__init__.pyi'], 'soliton_linkage': ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/soliton_linkage']),
        ('share/soliton_linkage', ['package.xml']),
    ],
    install_requires=['matplotlib', 'numba>=0.58', 'numpy', 'pyyaml', 'scipy'],
    extras_require={
        'benchmark': [
            'heyoka; python_version >= "3.11"',
            'mcap',
            'mujoco; python_version >= "3.11"',
        ],
    },
    entry_points={
        'console_scripts': [
            f'{name} = soliton_linkage.studies.{name}.program:main' for name in STUDIES
        ],
    },
    zip_safe=False,
)
