# SPDX-License-Identifier: Apache-2.0
"""Dockerfile and pixi.toml install what the packages depend on, and a few named tools."""

import re
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(ROOT.glob('src/*/package.xml'))
OTHER_NAMES = {
    'python3-opencv': 'py-opencv',
    'python3-serial': 'pyserial',
    'python3-yaml': 'pyyaml',
}
"""Packages of conda-forge that are not named after the rosdep key."""


def dependencies() -> set[str]:
    """Return the rosdep keys of all packages, without tests and the packages themselves."""
    keys = {
        str(element.text)
        for path in PACKAGES
        for element in ElementTree.parse(path).getroot()
        if element.tag.endswith('depend') and element.tag != 'test_depend'
    }
    return keys - {path.parent.name for path in PACKAGES}


def ros_package(key: str) -> str:
    return f'ros-jazzy-{key.replace("_", "-")}'


def debian_package(key: str) -> str:
    return key if key.startswith('python3-') else ros_package(key)


def conda_package(key: str) -> str:
    if not key.startswith('python3-'):
        return ros_package(key)
    return OTHER_NAMES.get(key, key.removeprefix('python3-'))


def test_the_container_has_the_dependencies_of_the_packages():
    text = (ROOT / 'Dockerfile').read_text(encoding='utf-8')
    listed = re.findall(r'^    ([a-z][a-z0-9-]*) \\$', text, re.MULTILINE)
    tools = {'build-essential', 'python3-colcon-common-extensions', 'python3-pip'}
    by_pip = {key for key in dependencies() if key.endswith('-pip')}
    assert set(listed) == tools | {debian_package(key) for key in dependencies() - by_pip}
    (installed,) = re.findall(r'pip install --\S+ --\S+ (.*)', text)
    assert {f'python3-{name}-pip' for name in installed.split()} == by_pip


def test_pixi_has_the_dependencies_of_the_packages():
    text = (ROOT / 'pixi.toml').read_text(encoding='utf-8')
    tables = dict(re.findall(r'^\[([a-z-]+)\]\n((?:[^\[\n].*\n)*)', text, re.MULTILINE))
    tools = {'colcon-common-extensions', 'compilers', 'ros-jazzy-ros-base'}
    by_pip = {key for key in dependencies() if key.endswith('-pip')}
    conda = set(re.findall(r'^(\S+) = ', tables['dependencies'], re.MULTILINE))
    assert conda == tools | {conda_package(key) for key in dependencies() - by_pip}
    pip = re.findall(r'^(\S+) = ', tables['pypi-dependencies'], re.MULTILINE)
    assert {f'python3-{name}-pip' for name in pip} == by_pip
