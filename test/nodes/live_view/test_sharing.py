# SPDX-License-Identifier: Apache-2.0
"""A shared run is one HTML file with all its data."""

import base64
import json
import re
from typing import Any

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.live_view.sharing import shared_page

LARGEST = 5_000_000


def page(rotors: int, frames: int, title: str = 'A run') -> str:
    chain = Chain(number_of_rotors=rotors)
    times = np.arange(frames) / 250.0 + 7.0
    angles = np.random.default_rng(1).normal(size=(frames, rotors))
    solitons = [[n / 10, 1e-4, 1.0] if n % 2 else [] for n in range(frames)]
    return shared_page(title, chain, times, angles, solitons)


def data_of(text: str) -> dict[str, Any]:
    found = re.search(r'id="share-data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def numbers(packed: str) -> Any:
    return np.frombuffer(base64.b64decode(packed), '<f4')


def test_the_frames_are_in_the_page():
    data = data_of(page(rotors=5, frames=20))
    assert numbers(data['times']) == pytest.approx(np.arange(20) / 250.0)
    expected = np.random.default_rng(1).normal(size=(20, 5))
    assert numbers(data['angles']).reshape(20, 5) == pytest.approx(expected, rel=1e-6)
    assert data['solitons'][:4] == [[], [0.1, 0.0001, 1.0], [], [0.3, 0.0001, 1.0]]


def test_a_long_recording_is_thinned_to_five_megabytes():
    for rotors, frames in [(3, 100_000), (400, 5_000), (4000, 900)]:
        text = page(rotors, frames)
        assert len(text.encode()) < LARGEST
        times = numbers(data_of(text)['times'])
        assert times[-1] > 0.9 * (frames - 1) / 250.0


def test_the_page_loads_nothing():
    text = page(rotors=5, frames=20)
    assert not re.search(r'<(link|img|iframe)\b|<script[^>]*\bsrc=|^import ', text, re.MULTILINE)
    assert not re.search(r'^export ', text, re.MULTILINE)


def test_a_title_is_text():
    text = page(rotors=5, frames=20, title='</script><b>x')
    assert '</script><b>' not in text
    assert data_of(text)['title'] == '</script><b>x'


def test_no_frames_are_reported():
    with pytest.raises(ValueError, match='no frame is recorded yet'):
        page(rotors=5, frames=0)
