# SPDX-License-Identifier: Apache-2.0
"""A registry contains the entries of the modules of its package and of other modules."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from soliton_linkage_studies.registry import Registry


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Create a package with an entry module and a program module; return its name."""
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


def test_another_module_may_add_entries(package: str) -> None:
    words: Registry[int] = importlib.import_module(package).WORDS
    words.add('two')(2)
    assert dict(words) == {'one': 1, 'two': 2}
    with pytest.raises(ValueError, match="already has an entry 'two'; choose another name"):
        words.add('two')(2)


def test_an_unknown_name_raises_a_key_error(package: str) -> None:
    words: Registry[int] = importlib.import_module(package).WORDS
    with pytest.raises(KeyError):
        words['three']
