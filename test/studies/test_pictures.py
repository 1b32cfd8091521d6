# SPDX-License-Identifier: Apache-2.0
"""Pictures show the angles at the right rotor and time, and are written to the given folder."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, chain_of
from matplotlib.figure import Figure
from matplotlib.image import imread

from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage.solitons.track import Crossing, Track, follow, measured_track
from soliton_linkage_studies.drawing import lean_norm
from soliton_linkage_studies.figure_report import save_figure
from soliton_linkage_studies.pictures import (
    kymograph,
    kymograph_figure,
    save_run,
    track_figure,
    track_positions,
    track_velocities,
    unbroken,
)

CHAIN = chain_of(FLIPPER, 20)


def new_axes() -> Any:
    return Figure().subplots()


@pytest.fixture
def recording():
    walls = np.array([static_wall(CHAIN, site) for site in np.linspace(9.5, 10.5, 9).tolist()])
    return Recording(0.5 * np.arange(9) + 2, walls, np.zeros_like(walls))


def test_a_kymograph_has_a_pixel_for_each_rotor_and_frame(recording):
    axes = new_axes()
    assert kymograph(axes, CHAIN, recording, follow(CHAIN, recording)) is axes
    (image,) = axes.images
    lean = CHAIN.rotor_length * np.sin(recording.angles)
    assert np.array_equal(image.get_array(), lean.T)
    assert image.origin == 'lower'
    # Each pixel is centred on its rotor and its frame.
    assert image.get_extent() == pytest.approx([1.75, 6.25, -0.5, 19.5])
    assert image.norm.vmax == -image.norm.vmin == CHAIN.rotor_length


def test_the_track_lies_over_the_wall_of_the_kymograph(recording):
    track = follow(CHAIN, recording)
    (line,) = kymograph(new_axes(), CHAIN, recording, track).lines
    assert line.get_xdata() == pytest.approx(recording.times)
    assert line.get_ydata() == pytest.approx(np.linspace(9.5, 10.5, 9), abs=0.001)


def test_a_kymograph_shows_the_tracks_of_all_walls(recording):
    class Wall(NamedTuple):
        rotor: float
        velocity: float = 0.0
        position_deviation: float = 0.1
        velocity_deviation: float = 0.1

    walls = [[Wall(3.0 + k), Wall(12.0)][: k % 3] for k in range(9)]
    track = measured_track(CHAIN, recording.times, walls)
    first, second = (
        each.get_ydata() for each in kymograph(new_axes(), CHAIN, recording, track).lines
    )
    np.testing.assert_array_equal(np.isfinite(first), [k % 3 > 0 for k in range(9)])
    np.testing.assert_array_equal(np.isfinite(second), [k % 3 > 1 for k in range(9)])
    assert np.nanmax(np.abs(second - 12.0)) == 0


def test_a_long_kymograph_is_thinned_out_and_keeps_its_span():
    times = 0.01 * np.arange(9000)
    angles = np.repeat(CHAIN.uniform_state(1)[None], 9000, axis=0)
    recording = Recording(times, angles, np.empty((0, 20)))
    track = Track(times, np.full(9000, np.nan), np.full(9000, np.nan))
    (image,) = kymograph(new_axes(), CHAIN, recording, track).images
    assert image.get_array().shape[1] < 4000
    assert image.get_extent()[:2] == pytest.approx([0, 90], abs=0.05)


def test_a_track_shows_position_velocity_and_the_mean_of_each_crossing():
    times = np.linspace(0, 10, 11)
    track = Track(times, 2 * times, np.full(11, 2.0))
    crossings = (Crossing(1.0, 4.0, 1, 2.0), Crossing(6.0, 9.0, -1, 3.0))
    position, velocity = track_positions(new_axes(), CHAIN, track), new_axes()
    assert track_velocities(velocity, track, crossings) is velocity
    assert position.lines[0].get_ydata() == pytest.approx(track.sites)
    assert position.get_ylim() == (0, 19)
    means = [
        (list(line.get_xdata()), list(line.get_ydata()))
        for line in velocity.lines
        if line.get_linestyle() == '--'
    ]
    assert means == [([1.0, 4.0], [2.0, 2.0]), ([6.0, 9.0], [-3.0, -3.0])]
    low, high = velocity.get_ylim()
    assert low < -3 < 3 < high


def test_oscillations_about_rest_have_distinct_colours_in_every_chain():
    for example in EXAMPLES:
        chain = chain_of(example, 20)
        rest = chain.rotor_length * np.sin(chain.rest_angle)
        norm = lean_norm(chain)
        seen = norm([-1.03 * rest, -rest, -0.97 * rest, 0, 0.97 * rest, rest, 1.03 * rest])
        assert (np.diff(seen) > 0.03).all()
        assert np.asarray(seen + seen[::-1]) == pytest.approx(np.ones(7), abs=1e-9)
        assert seen[5] == pytest.approx(
            float(lean_norm(CHAIN)(CHAIN.rotor_length * np.sin(CHAIN.rest_angle)))
        )
        assert np.asarray(norm.inverse(seen))[4:] == pytest.approx(
            rest * np.array([0.97, 1, 1.03])
        )


def test_a_track_has_a_band_of_twice_its_deviations():
    times = np.linspace(0, 4, 5)
    track = Track(times, 3 * times, np.full(5, 3.0), np.full(5, 0.25), np.full(5, 0.5))
    position, velocity = track_positions(new_axes(), CHAIN, track), new_axes()
    track_velocities(velocity, track, ())
    for axes, middle, off in ((position, track.sites, 0.5), (velocity, track.site_rates, 1.0)):
        (band,) = axes.collections
        low, high = band.get_datalim(axes.transData).intervaly
        assert (low, high) == pytest.approx((middle.min() - off, middle.max() + off))
        assert axes.lines[0].get_zorder() > band.get_zorder()
    *_, shown = track_figure(CHAIN, track, ()).axes
    assert [set(line.get_ydata()) for line in shown.lines] == [{0.25}, {0.5}]


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_figures_of_one_frame_show_something_and_name_the_chain(example, tmp_path):
    chain = chain_of(example, 8)
    recording = Recording(np.zeros(1), chain.uniform_state(1)[None], np.empty((0, 8)))
    track = follow(chain, recording)
    for figure in (kymograph_figure(chain, recording, track), track_figure(chain, track, ())):
        save_figure(figure, tmp_path / 'picture.png')
        assert imread(tmp_path / 'picture.png').std() > 0.01
        title = figure.axes[0].get_title()
        assert chain.motion.value in title
        assert '8 rotors' in title


def test_a_run_is_saved_as_two_pictures_with_a_caption_each(recording, tmp_path):
    save_run(CHAIN, recording, follow(CHAIN, recording), (), tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        f'{name}.{kind}' for name in ('kymograph', 'track') for kind in ('png', 'txt')
    }
    words = (tmp_path / 'kymograph.txt').read_text(encoding='utf-8')
    for explained in ('purple', 'orange', 'black', 'edge rotor', CHAIN.motion.value):
        assert explained in words


def test_a_track_is_interrupted_where_it_changes_to_another_soliton():
    sites = np.array([24.0, 24.5, 12.0, 12.5, np.nan, 30.0, 31.0])
    track = Track(np.arange(7.0), sites, 0 * sites)
    shown = unbroken(track.sites)
    np.testing.assert_array_equal(shown, [24.0, 24.5, np.nan, 12.5, np.nan, 30.0, 31.0])
    assert track.sites[2] == 12.0
