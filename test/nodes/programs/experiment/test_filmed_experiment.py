# SPDX-License-Identifier: Apache-2.0
"""The filmed experiment rejects unknown parameters; its page links all its files."""

import re
from pathlib import Path

import pytest

from soliton_linkage_nodes.programs.experiment.filmed_experiment import run, write_film_page

CONFIG = Path(__file__).resolve().parents[4] / 'config/filmed.yaml'


def test_unknown_parameters_are_rejected(tmp_path):
    for given, said in [
        ({'kicks': 3.0}, 'unknown parameter kicks'),
        ({'duration': 0.0}, 'duration = 0.0 must lie in the range 1 to 3600 s'),
    ]:
        with pytest.raises(ValueError, match=said):
            run(CONFIG, given, tmp_path)


def test_the_page_shows_films_report_and_track_beside_each_other(tmp_path):
    write_film_page(tmp_path, 'placed to < 0.01')
    page = (tmp_path / 'index.html').read_text(encoding='utf-8')
    shown = re.findall(r'src="(.*?)"', page)
    assert shown == ['film.mp4', 'overlay.mp4', 'identification.png', 'track.png']
    assert 'placed to &lt; 0.01' in page
