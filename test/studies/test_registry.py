# SPDX-License-Identifier: Apache-2.0
"""A registry holds what the modules of its package add, and what is added from outside."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from soliton_linkage_studies.registry import Registry


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Name of a package with two modules, of which one is its program."""
    name = 'package_of_words'
    folder = tmp_path / name
    folder.mkdir()
    head = 'from soliton_linkage_studies.registry import Registry\n'
    (folder / '__init__.py').write_text(f'{head}WORDS = Registry({name!r})\n')
    (folder / 'first.py').write_text(f"from {name} import WORDS\nWORDS.add('one')(1)\n")
    (folder / 'program.py').write_text(f"from {name} import WORDS\nWORDS.add('run')(0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield name
    for module in [each for each in sys.modules if each.split('.')[0] == name]:
        del sys.modules[module]


def test_it_finds_the_modules_of_its_package_but_not_its_program(package: str) -> None:
    words: Registry[int] = importlib.import_module(package).WORDS
    assert dict(words) == {'one': 1}
    assert len(words) == 1


def test_another_module_may_add_to_it(package: str) -> None:
    words: Registry[int] = importlib.import_module(package).WORDS
    words.add('two')(2)
    assert dict(words) == {'one': 1, 'two': 2}
    with pytest.raises(ValueError, match="has a 'two' already; choose another name"):
        words.add('two')(2)


def test_what_is_not_there_is_a_key_error(package: str) -> None:
    words: Registry[int] = importlib.import_module(package).WORDS
    with pytest.raises(KeyError):
        words['three']
