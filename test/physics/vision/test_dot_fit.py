# SPDX-License-Identifier: Apache-2.0
"""Fitted centres agree with the drawn ones to within the stated errors."""

import numpy as np
import pytest
from scipy.special import erfc

from soliton_linkage.vision.dot_fit import FittedDots, fit_dots

RADIUS, LABEL, NOISE = 3.0, 6.4, 2.0
AT_REST, CIRCLE = np.zeros(2), np.eye(2)
OVAL = np.array([[0.9, 0.1], [0.1, 1.01 / 0.9]])
"""Map from an ellipse to a circle, of determinant 1."""


def fitted(
    places: np.ndarray,
    way: np.ndarray = AT_REST,
    noise: float = NOISE,
    shape: np.ndarray = CIRCLE,
    dark_noise: float = 0.0,
    halo: float = 0.0,
) -> FittedDots:
    """Fit dots drawn on labels in tiles of 20 pixels on a dark background.

    The noise of black pixels is larger by `dark_noise`. A part `halo` of the light is blurred by
    1.5 pixels instead of 0.55 pixels.
    """

    def disc(away: np.ndarray, radius: float) -> np.ndarray:
        parts = ((1 - halo, 0.55), (halo, 1.5))
        return sum(part * erfc((away - radius) / blur / np.sqrt(2)) / 2 for part, blur in parts)

    generator = np.random.default_rng(5)
    rows, columns = np.mgrid[0:20, 0:20]
    tiles, starts = [], []
    for number, (x, y) in enumerate(places):
        cover, dark = np.zeros((20, 20)), np.zeros((20, 20))
        for share in np.linspace(-0.5, 0.5, 21):
            from_it = np.stack([columns - x - share * way[0], rows - y - share * way[1]])
            away = np.hypot(*np.tensordot(shape, from_it, 1))
            dot, label = disc(away, RADIUS), disc(away, LABEL)
            cover += (40 + 180 * label - 170 * dot) / 21
            dark += dot / 21
        tiles.append(
            cover * (1 + 0.004 * (columns - 10))
            + (noise + dark_noise * dark) * generator.normal(size=(20, 20))
        )
        starts.append((20 * number + round(x), round(y)))
    picture = np.clip(np.rint(np.hstack(tiles)), 0, 255).astype(np.uint8)
    ways = np.tile(way, (len(places), 1))
    outlines = np.tile(shape / RADIUS, (len(places), 1, 1))
    found = fit_dots(picture, np.array(starts, dtype=float), outlines, RADIUS / LABEL, ways)
    found.centres[:, 0] -= 20 * np.arange(len(places))
    return found


@pytest.mark.parametrize('shape', [CIRCLE, OVAL], ids=['circle', 'oval'])
def test_errors_of_centres_agree_with_the_stated_covariances(shape):
    places = 9.5 + np.random.default_rng(1).uniform(-0.5, 0.5, (200, 2))
    found = fitted(places, shape=shape)
    errors = found.centres - places
    stated = np.sqrt(found.covariances[:, [0, 1], [0, 1]])
    assert np.sqrt(np.mean(errors**2)) < 0.02
    assert 0.85 < np.sqrt(np.mean((errors / stated) ** 2)) < 1.15
    assert np.abs(errors.mean(axis=0)).max() < 3 * 0.02 / np.sqrt(200)


@pytest.mark.parametrize(('dark_noise', 'halo'), [(12.0, 0.0), (0.0, 0.2)])
def test_covariances_hold_for_unequal_noise_and_for_another_blur(dark_noise, halo):
    places = 9.5 + np.random.default_rng(3).uniform(-0.5, 0.5, (400, 2))
    found = fitted(places, noise=1.0, dark_noise=dark_noise, halo=halo)
    stated = np.sqrt(found.covariances[:, [0, 1], [0, 1]])
    assert 0.9 < np.sqrt(np.mean(((found.centres - places) / stated) ** 2)) < 1.1


def test_the_centre_of_a_moving_dot_is_the_middle_of_its_path():
    places = 9.5 + np.random.default_rng(2).uniform(-0.5, 0.5, (50, 2))
    found = fitted(places, np.array([2.0, 1.0]))
    assert np.sqrt(np.mean((found.centres - places) ** 2)) < 0.03
    assert np.median(found.residuals) < 2 * NOISE


def test_no_starts_give_no_dots():
    picture = np.zeros((20, 20), dtype=np.uint8)
    none = np.zeros((0, 2))
    assert not len(fit_dots(picture, none, np.zeros((0, 2, 2)), 0.5, none).centres)
