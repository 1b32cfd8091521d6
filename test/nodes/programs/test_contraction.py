# SPDX-License-Identifier: Apache-2.0
"""Recorded solitons have the predicted widths; failures are reported."""

import re

import pytest
from matplotlib.image import imread

from soliton_linkage_nodes.programs import contraction
from soliton_linkage_nodes.programs.contraction import main, measure

SETTINGS = """
contraction:
  seed: 5
  noise: 0.005
  frames: 1000
  chains:
    wide:
      chain: {number_of_rotors: 40, rotor_length_ratio: 4.0, rest_angle: 0.9,
              spacing: 1.0, mass: 1.0, stiffness: 1.0}
      kicks: [0.6]
      reference: {kicks: [0.6], speeds: [0.1811], widths: [0.945]}
"""


def test_a_recorded_wall_has_the_width_of_theory(tmp_path, capsys, monkeypatch):
    passages = []
    monkeypatch.setattr(
        contraction, 'measure', lambda bag: passages.append(measure(bag)) or passages[-1]
    )
    settings = tmp_path / 'settings.yaml'
    settings.write_text(SETTINGS)
    main([str(settings), '--output', str(tmp_path)])
    assert 'contraction_recorded.md and contraction_recorded.png are in' in capsys.readouterr().out
    (passage,) = passages
    contracted = (1 - passage.speed**2) ** 0.5
    assert passage.width == pytest.approx(contracted, abs=0.005 + 4 * passage.width_deviation)
    table = (tmp_path / 'contraction_recorded.md').read_text(encoding='utf-8')
    errors = [float(each) for each in re.findall(r'([+-]\S+) %', table)]
    assert len(errors) == 2
    assert max(map(abs, errors)) < 1
    assert imread(tmp_path / 'contraction_recorded.png').std() > 0.02


def test_it_reports_why_a_wall_is_recorded_again(tmp_path, capsys, monkeypatch):
    settings = tmp_path / 'settings.yaml'
    settings.write_text(SETTINGS)
    bags = iter(['first', 'second'])

    def fail(*_: object) -> None:
        raise ValueError(f'the {next(bags)} bag shows no wall')

    monkeypatch.setattr(contraction, 'record', fail)
    with pytest.raises(SystemExit) as end:
        main([str(settings), '--output', str(tmp_path)])
    said = 'recording wide, kick 0.6 again, because: the first bag shows no wall'
    assert f'contraction: {said}' in capsys.readouterr().err.splitlines()
    assert 'the second bag shows no wall' in str(end.value)


def test_settings_without_walls_are_rejected(tmp_path):
    settings = tmp_path / 'settings.yaml'
    settings.write_text('record: {}\n')
    with pytest.raises(SystemExit) as end:
        main([str(settings), '--output', str(tmp_path)])
    assert 'contraction' in str(end.value)
