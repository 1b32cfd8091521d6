# SPDX-License-Identifier: Apache-2.0
"""A filmed bench has a chain with deviations, and markers printed for its plan."""

import numpy as np
import pytest
from filmed_chains import CAMERA

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.vision.angle_camera import AngleCamera
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage_studies.camera import runs
from soliton_linkage_studies.camera.runs import BenchParameters, FilmedBench

PLAN = Chain(6, 0.1, 0.05, 0.97)
BENCH = FilmedBench(PLAN, MarkerSettings(), BenchParameters(seed=3, duration=0.5))


def test_the_chain_differs_from_its_plan_and_walls_pass():
    made = BENCH.chain
    assert not blocked_bonds(made).any()
    for name in ('rotor_lengths', 'spacings', 'rest_lengths'):
        of_plan = getattr(PLAN, name)
        assert 0.01 < np.std(getattr(made, name) / of_plan) < 0.12, name


def test_a_camera_with_only_the_plan_measures_the_true_angles(monkeypatch):
    pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    monkeypatch.setattr(runs, 'CAMERA', CAMERA)
    film = BENCH.film()
    eye = AngleCamera(MarkerLayout(PLAN), CAMERA)
    shots = [next(film) for _ in range(3)]
    seen = [eye.measure(shot.time, shot.picture) for shot in shots]
    true = BENCH.angles(np.array([shot.time for shot in shots]))
    assert np.abs(np.array([frame.angles for frame in seen]) - true)[1:].max() < 0.01
