# SPDX-License-Identifier: Apache-2.0
"""The packages import exactly the dependencies of their package.xml and setup.py."""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import requires
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from setuptools.dist import Distribution

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / 'src'
PACKAGES = ['soliton_linkage', 'soliton_linkage_studies', 'soliton_linkage_nodes']
OWN = {*PACKAGES, 'soliton_linkage_msgs'}
KEYS = {
    'argcomplete': 'python3-argcomplete',
    'backports': 'python3-rosbags-pip',
    'lz4': 'python3-rosbags-pip',
    'matplotlib': 'python3-matplotlib',
    'mpl_toolkits': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
}
"""Key of rosdep by imported name; ROS packages have their own name."""
PROJECTS = {'backports': 'backports.zstd', 'mpl_toolkits': 'matplotlib', 'yaml': 'pyyaml'}
"""Name on PyPI by imported name, if they differ."""
OF_THE_PAGE = {'fastapi', 'nicegui', 'starlette', 'uvicorn'}
"""Imports of the live page only, which is an extra: rosdep has no key for nicegui."""
WHEN_NEEDED = {
    'soliton_linkage': {'python3-opencv'},
    'soliton_linkage_studies': set(),
    'soliton_linkage_nodes': {'python3-serial'},
}
"""Keys of the imports for a camera or a serial port, which are extras on PyPI."""
EXTRAS = {*OF_THE_PAGE, 'foxglove'}
"""Imports of extras; a ROS install has its own bridge to Foxglove."""


@cache
def imported(package: str) -> frozenset[str]:
    """Return the top names that a package and its launch files import, without Python's own."""
    folder = SOURCES / package
    paths = [*folder.glob(f'{package}/**/*.py'), *folder.glob('launch/*.py')]
    names = {name.partition('.')[0] for path in paths for name in imports(path)}
    return frozenset(names - sys.stdlib_module_names - {package})


def imports(path: Path) -> Iterator[str]:
    for statement in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(statement, ast.Import):
            yield from (alias.name for alias in statement.names)
        elif isinstance(statement, ast.ImportFrom):
            yield str(statement.module)


def manifest(package: str) -> ElementTree.Element:
    return ElementTree.parse(SOURCES / package / 'package.xml').getroot()


def declared(package: str) -> set[str]:
    return {
        str(key.text) for kind in ('depend', 'exec_depend') for key in manifest(package).iter(kind)
    }


def setup_data(package: str, monkeypatch: pytest.MonkeyPatch, *command: str) -> dict[str, Any]:
    """Return what a package's setup.py gives to setuptools for a command."""
    given: dict[str, Any] = {}
    monkeypatch.chdir(SOURCES / package)
    monkeypatch.setattr('setuptools.setup', lambda **data: given.update(data))
    monkeypatch.setattr(sys, 'argv', ['setup.py', *command])
    path = SOURCES / package / 'setup.py'
    module = {'__file__': str(path)}
    exec(compile(path.read_text(encoding='utf-8'), path, 'exec'), module)
    module['SCRATCH'].cleanup()
    return given


def project(requirement: str) -> str:
    name = requirement.partition(';')[0]
    for mark in '<>=[ ':
        name = name.partition(mark)[0]
    return name.lower().replace('_', '-')


@pytest.mark.parametrize('package', PACKAGES)
def test_rosdep_installs_the_imported_packages(package):
    needed = {KEYS.get(name, name) for name in imported(package) - EXTRAS}
    assert declared(package) == needed | WHEN_NEEDED[package]


def test_packages_without_a_key_are_dependencies_of_packages_with_one():
    brought = {project(requirement) for requirement in requires('rosbags') or []}
    assert {'backports.zstd', 'lz4'} <= brought


@pytest.mark.parametrize('package', PACKAGES)
def test_pip_installs_the_imported_packages(package, monkeypatch):
    data = setup_data(package, monkeypatch, 'bdist_wheel')
    extras = data.get('extras_require', {})
    required = {project(name) for name in data['install_requires']}
    optional = {
        project(name) for part in ('completion', 'camera') for name in extras.get(part, [])
    }
    own = {'soliton_linkage', 'soliton_linkage_studies'} & imported(package)
    imports_of_it = {*(name for name in imported(package) if name in KEYS), *own}
    needed = {project(PROJECTS.get(name, name)) for name in imports_of_it}
    assert required <= needed <= required | optional


def test_the_page_is_an_extra(monkeypatch):
    data = setup_data('soliton_linkage_nodes', monkeypatch, 'bdist_wheel')
    assert [project(name) for name in data['extras_require']['live']] == ['nicegui']
    brought = {project(requirement) for requirement in requires('nicegui') or []}
    assert OF_THE_PAGE & imported('soliton_linkage_nodes') == OF_THE_PAGE <= brought | {'nicegui'}


def test_the_server_for_foxglove_is_an_extra(monkeypatch):
    data = setup_data('soliton_linkage_nodes', monkeypatch, 'bdist_wheel')
    assert data['extras_require']['foxglove'] == ['foxglove-sdk']
    assert 'foxglove' in imported('soliton_linkage_nodes')


def test_the_camera_is_an_extra(monkeypatch):
    data = setup_data('soliton_linkage', monkeypatch, 'bdist_wheel')
    extra = {project(name) for name in data['extras_require']['camera']}
    assert extra == {'av', 'matplotlib', 'opencv-python-headless'}


def test_the_serial_port_is_an_extra(monkeypatch):
    data = setup_data('soliton_linkage', monkeypatch, 'bdist_wheel')
    assert [project(name) for name in data['extras_require']['serial']] == ['pyserial']
    nodes = setup_data('soliton_linkage_nodes', monkeypatch, 'bdist_wheel')
    assert nodes['extras_require']['serial'] == ['soliton_linkage[serial]']


def test_a_plain_colcon_build_makes_the_packages_of_the_suite_alone():
    found = set()
    for folder, subfolders, files in os.walk(ROOT):
        if 'COLCON_IGNORE' in files:
            subfolders.clear()
        elif 'package.xml' in files:
            found.add(Path(folder).name)
        subfolders[:] = [name for name in subfolders if not name.startswith('.')]
    assert found == OWN


def test_one_version(monkeypatch):
    manifests = {manifest(package).findtext('version') for package in OWN}
    (version,) = manifests
    for package in PACKAGES:
        assert setup_data(package, monkeypatch)['version'] == version


@pytest.mark.parametrize('package', PACKAGES)
def test_a_build_by_pip_leaves_the_source_tree_unchanged(package, tmp_path):
    source = tmp_path / 'source'
    shutil.copytree(SOURCES / package, source, ignore=shutil.ignore_patterns('__pycache__'))
    before = sorted(source.rglob('*'))
    commands = ['egg_info', 'build', '--build-lib', str(tmp_path / 'built')]
    subprocess.run([sys.executable, 'setup.py', '-q', *commands], cwd=source, check=True)
    assert sorted(source.rglob('*')) == before
    assert (tmp_path / 'built' / package / '__init__.py').is_file()


def test_a_wheel_puts_one_name_on_the_path(monkeypatch):
    names = {
        command: [
            script.partition(' = ')[0]
            for package in PACKAGES
            for script in setup_data(package, monkeypatch, command)['entry_points'].get(
                'console_scripts', []
            )
        ]
        for command in ('bdist_wheel', 'install', 'develop')
    }
    assert names['bdist_wheel'] == ['soliton-linkage']
    assert 'simulator' in names['install']
    assert names['install'] == names['develop']


@pytest.mark.parametrize(
    ('package', 'share', 'sources'),
    [
        ('soliton_linkage_nodes', 'config', 'config/*.yaml'),
        ('soliton_linkage_nodes', 'config/views', 'config/views/*'),
        ('soliton_linkage_nodes', 'bags', 'bags/*/*'),
        ('soliton_linkage_nodes', 'launch', 'src/soliton_linkage_nodes/launch/*'),
        ('soliton_linkage_studies', 'settings', 'config/studies/*'),
    ],
)
def test_settings_and_bags_are_installed(monkeypatch, package, share, sources):
    data = setup_data(package, monkeypatch)
    installed = {
        Path(name).name
        for folder, names in data['data_files']
        if folder.startswith(f'share/{package}/{share}')
        for name in names
    }
    assert {path.name for path in ROOT.glob(sources)} <= installed
    assert all(
        Path(name).is_file() and '..' not in Path(name).parts
        for _, names in data['data_files']
        for name in names
    )


def test_metadata_of_the_physics(monkeypatch):
    data = setup_data('soliton_linkage', monkeypatch)
    found = Distribution(data).metadata
    assert 'import soliton_linkage as sl' in found.get_long_description()
    assert found.get_url()
    assert (SOURCES / 'soliton_linkage' / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()
    assert data['python_requires'] == '>=3.10'


def test_studies_without_matplotlib_name_the_package_to_install():
    hidden = """
import sys
from importlib.machinery import PathFinder

class Hidden(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name == 'matplotlib' else PathFinder.find_spec(name, path, target)

sys.meta_path[:] = [Hidden if finder is PathFinder else finder for finder in sys.meta_path]
import soliton_linkage as sl
chain = sl.Chain(number_of_rotors=4)
sl.leaning(chain, -1)
from soliton_linkage.command import main
sys.exit(main(['figures', '--quick']))
"""
    done = subprocess.run(
        [sys.executable, '-c', hidden],
        capture_output=True,
        text=True,
        env={**os.environ},
        check=False,
    )
    assert done.stderr.splitlines()[-1] == (
        "soliton-linkage figures: No module named 'matplotlib'; "
        'pip install matplotlib, or the rosdep key python3-matplotlib'
    )
