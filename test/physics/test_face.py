# SPDX-License-Identifier: Apache-2.0
"""The face of the package: its public names and the examples in docstrings."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest

import soliton_linkage
from soliton_linkage import actuation, dynamics, estimation, linear, linkage, orbit, solitons
from soliton_linkage import steering as steering_package

PACKAGES = [
    *(soliton_linkage, linkage, linear, solitons, orbit, dynamics, actuation, estimation),
    steering_package,
]
HOME = Path(soliton_linkage.__file__).parent
WITH_EXAMPLES = [
    '.'.join(('soliton_linkage', *path.relative_to(HOME).with_suffix('').parts)).removesuffix(
        '.__init__'
    )
    for path in sorted(HOME.glob('**/*.py'))
    if '>>> ' in path.read_text(encoding='utf-8')
]


@pytest.mark.parametrize('package', PACKAGES, ids=lambda package: package.__name__)
def test_every_public_name_is_there_and_documented(package):
    assert package.__all__
    for name in package.__all__:
        assert getattr(package, name).__doc__, name
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match='no attribute'):
        _ = package.no_such_name


@pytest.mark.parametrize('module', WITH_EXAMPLES)
def test_examples_in_docstrings_are_true(module):
    results = doctest.testmod(import_module(module))
    assert results.attempted > 0
    assert results.failed == 0
