# SPDX-License-Identifier: Apache-2.0
"""Errors of settings name the file, key, value, limit and remedy."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.settings import Section, chain_from, load_settings

SECTION = Section('file.yaml', 'part', {'x': 2, 'name': 'left', 'many': [1, 2.5], 'sub': {'y': 1}})
CHAIN = {'number_of_rotors': 7, 'rotor_length_ratio': 0.5, 'rest_angle': 0.97}


def written(folder: Path, text: str) -> Path:
    path = folder / 'settings.yaml'
    path.write_text(text, encoding='utf-8')
    return path


def test_values_are_read_with_the_requested_type(tmp_path):
    settings = load_settings(
        written(tmp_path, 'x: 1.5\nn: 3\nname: abc\nmany: [1, 2]\nparts: {one: {y: 1}, two: {}}\n')
    )
    assert settings.number('x', 0, 2) == 1.5
    assert settings.whole_number('n', 3, 3) == 3
    assert settings.text('name') == 'abc'
    assert settings.numbers('many', 1, 2) == (1.0, 2.0)
    parts = settings.sections('parts')
    assert [part.name for part in parts.values()] == ['parts.one', 'parts.two']
    assert parts['one'].number('y', 0, 2) == 1


def test_only_absent_keys_take_their_default():
    assert SECTION.number('absent', 0, 1, 0.5) == 0.5
    assert SECTION.whole_number('absent', 0, 1, 1) == 1
    assert SECTION.text('absent', ('left', 'right'), 'right') == 'right'
    assert SECTION.number('x', 0, 9, 0.5) == 2
    assert SECTION.whole_number('x', 0, 9, 1) == 2
    assert SECTION.text('name', ('left', 'right'), 'right') == 'left'


@given(st.floats(-1e6, 1e6), st.floats(0, 1e6), st.floats(-3e6, 3e6))
def test_a_range_includes_its_bounds(minimum, span, value):
    maximum = minimum + span
    section = Section('file.yaml', '', {'x': value, 'low': minimum, 'high': maximum})
    assert section.number('low', minimum, maximum) == minimum
    assert section.number('high', minimum, maximum) == maximum
    if minimum <= value <= maximum:
        assert section.number('x', minimum, maximum) == value
    else:
        with pytest.raises(ValueError, match=r'file\.yaml: x = .* must be a number in the range'):
            section.number('x', minimum, maximum)


def test_a_value_that_is_no_finite_number_is_rejected_by_name(tmp_path):
    for value in ['1e-3', True, None, [1], float('nan'), float('inf')]:
        section = Section('file.yaml', 'part', {'x': value})
        message = re.escape(f'file.yaml: part.x = {value!r} must be a number in the range 0 to 1')
        with pytest.raises(ValueError, match=message):
            section.number('x', 0, 1)
    settings = load_settings(written(tmp_path, 'x: 1e-3\n'))
    with pytest.raises(ValueError, match=r"x = '1e-3' must be .*; write exponents as 1\.0e-3"):
        settings.number('x', 0, 1)


def test_an_error_names_file_key_and_limit():
    for read, message in [
        (lambda: SECTION.number('y', 0, 1), 'part.y is missing; give a number in the range 0 to'),
        (lambda: SECTION.number('x', 3, 4), 'part.x = 2 must be a number in the range 3 to 4; ch'),
        (lambda: SECTION.whole_number('many', 0, 1), 'part.many = [1, 2.5] must be a whole numbe'),
        (lambda: SECTION.numbers('many', 0, 2), 'part.many = [1, 2.5] must be a list of numbers '),
        (lambda: SECTION.numbers('x', 0, 2), 'part.x = 2 must be a list of numbers in the range '),
        (lambda: SECTION.text('x'), 'part.x = 2 must be a text'),
        (
            lambda: SECTION.text('name', ('up', 'down')),
            "part.name = 'left' must be one of up, dow",
        ),
        (lambda: SECTION.section('x'), 'part.x = 2 must be a section; indent its keys beneath it'),
        (lambda: SECTION.sections('x'), 'part.x = 2 must be a section'),
        (
            lambda: SECTION.check_keys('x', 'y'),
            "part.name = 'left' is not known; known keys are x, y",
        ),
        (lambda: SECTION.section('sub').text('y'), 'part.sub.y = 1 must be a text'),
    ]:
        with pytest.raises(ValueError, match=re.escape(f'file.yaml: {message}')):
            read()
    section = Section('file.yaml', '', {'n': 3.0})
    with pytest.raises(ValueError, match=r'n = 3\.0 must be a whole .* omit the decimal poi'):
        section.whole_number('n', 0, 9)


def test_a_file_without_settings_or_text_is_rejected(tmp_path):
    for text, message in [
        ('x: [1', 'is not YAML .*line'),
        ('- 1\n- 2\n', 'contains list .* instead of sections of keys and values'),
        ('', 'contains NoneType'),
        ('1: 2\n', 'key 1 must be a text; put it in quotes'),
    ]:
        path = written(tmp_path, text)
        with pytest.raises(ValueError, match=f'{re.escape(str(path))}: .*{message}'):
            load_settings(path)
    with pytest.raises(ValueError, match=r'absent\.yaml: cannot be read .*; give a settings file'):
        load_settings(tmp_path / 'absent.yaml')
    (tmp_path / 'binary').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ValueError, match='binary: cannot be read'):
        load_settings(tmp_path / 'binary')


@given(st.floats(0.02, 20), st.floats(0.01, 1.56), st.floats(1e-3, 10))
def test_a_chain_has_the_given_ratio_and_scale(ratio, rest_angle, spacing):
    values = {**CHAIN, 'rotor_length_ratio': ratio, 'rest_angle': rest_angle, 'spacing': spacing}
    chain = chain_from(Section('file.yaml', 'chain', values))
    assert chain == Chain(7, spacing, ratio * spacing, rest_angle)


def test_a_chain_takes_optional_keys_and_requires_its_shape():
    values = {**CHAIN, 'mass': 3, 'stiffness': 2.0, 'damping': 0.1}
    chain = chain_from(Section('file.yaml', 'chain', values))
    assert (chain.mass, chain.stiffness, chain.damping) == (3, 2, 0.1)
    for key in CHAIN:
        values = {name: value for name, value in CHAIN.items() if name != key}
        with pytest.raises(ValueError, match=f'chain.{key} is missing; give'):
            chain_from(Section('file.yaml', 'chain', values))


def test_an_invalid_chain_is_rejected():
    for key, value, message in [
        ('rest_angle', 2, 'chain.rest_angle = 2 must be a number in the range 0.001 to 1.57'),
        ('number_of_rotors', 1, 'chain.number_of_rotors = 1 must be a whole number in the range'),
        ('rotor_length', 0.1, 'chain.rotor_length = 0.1 is not known; known keys are number'),
        ('rotor_length_ratio', 0, 'chain.rotor_length_ratio = 0 must be a number in the range'),
        ('damping', -1, 'chain.damping = -1 must be a number in the range 0 to'),
        ('spacing', 1000, 'chain gives Chain.rotor_length = 500000.0 must lie in the range'),
    ]:
        values = {**CHAIN, key: value}
        if key == 'spacing':
            values['rotor_length_ratio'] = 500
        with pytest.raises(ValueError, match=re.escape(f'file.yaml: {message}')):
            chain_from(Section('file.yaml', 'chain', values))
