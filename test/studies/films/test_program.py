# SPDX-License-Identifier: Apache-2.0
"""Films have the requested frames, show the motion, and never appear unfinished."""

import importlib
import os
import re
import signal
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import yaml
from chains import EXAMPLES, WIDE_FLIPPER, chain_of
from linkage_motion import distance, wall_between
from matplotlib.quiver import Quiver
from PIL import Image
from study_files import written

from soliton_linkage.linear.bands import couplings, gap
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Chain, Motion, staggered
from soliton_linkage.vision.video import read_video
from soliton_linkage_studies import program
from soliton_linkage_studies.films import program as films_program
from soliton_linkage_studies.films.cycle import (
    CycleScene,
    StaggeredScene,
    TiltScene,
    from_behind,
    layered,
)
from soliton_linkage_studies.films.insulator import CellScene, driven
from soliton_linkage_studies.films.program import (
    GIF,
    MP4,
    Film,
    file_kind,
    main,
    make_films,
    read_films,
    resized,
    scene_of,
    write_film,
)
from soliton_linkage_studies.films.scenes import FILM_KINDS, STYLE, static_profile
from soliton_linkage_studies.settings import load_settings

CONFIG = Path(__file__).parents[3] / 'config/studies/films.yaml'
ALL = read_films(load_settings(CONFIG))
NAMES = [film.name for film in ALL]


def film_of(number: str) -> Film:
    (found,) = (film for film in ALL if film.name.startswith(f'{number}_'))
    return found


@cache
def scene(number: str, frames: int = 21) -> Any:
    """Return the scene of a film; its motion is simulated once for all tests."""
    with mpl.rc_context(STYLE):
        return scene_of(resized(film_of(number), 640, 360, frames))


def changed(folder: Path, film: str | None = None, **values: object) -> Path:
    """Write the settings with other values in a film, or at the top; None removes a key."""
    content: Any = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    section = content['films'][film] if film else content
    for key, value in values.items():
        section.pop(key, None)
        if value is not None:
            section[key] = value
    return written(content, folder)


def frames_of(path: Path, width: int, height: int) -> int:
    """Return the number of decoded frames of a film, and check their size [pixels]."""
    shapes = [picture.shape for _, picture in read_video(path).pictures]
    assert set(shapes) == {(height, width, 3)}
    return len(shapes)


def test_films_are_made_by_the_requested_number_of_processes(tmp_path, monkeypatch):
    counts = []

    def counted(count: int, *_: Any) -> Any:
        counts.append(count)
        raise OSError('none is started')

    monkeypatch.setattr(program, 'local_processes', counted)
    command = [str(CONFIG), '--output', str(tmp_path), '--quick', '--only', 'S6', 'S7']
    for workers in ('1', '2', '5'):
        assert main([*command, '--workers', workers]) == 1
    assert counts == [1, 2, 2]


def test_the_projections_of_a_tilted_linkage_are_those_of_its_rotors():
    tilted = scene('S2', 136)
    assert isinstance(tilted, TiltScene)
    (strip,) = (each for each in tilted.figure.axes if each.get_title('left').startswith('u = '))
    (arrows,) = (each for each in strip.collections if isinstance(each, Quiver))
    for frame in (0, 70, 135):
        tilted.show(frame)
        chain = film_of('S2').motion.chain
        expected = chain.rotor_length * np.sin(tilted.angles[frame])
        assert np.asarray(arrows.U) == pytest.approx(expected)
        assert np.asarray(arrows.get_array()) == pytest.approx(expected)


def test_the_papers_movies_are_all_there():
    assert [name.split('_')[0] for name in NAMES] == [f'S{n}' for n in range(1, 10)]
    assert {film.kind for film in ALL} == set(FILM_KINDS)


def test_a_quick_run_makes_nine_playable_films(tmp_path, capsys):
    output = tmp_path / 'new' / 'films'
    # The same films of shorter motions.
    content: Any = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    for film in content['films'].values():
        film.update({key: 0.05 * film[key] for key in ('duration',) if key in film})
    config = written(content, tmp_path)
    assert main([str(config), '--output', str(output), '--quick', '--workers', '1']) == 0
    suffix, described = file_kind()
    captions = [output / f'{name}.txt' for name in NAMES]
    films = sorted(set(output.iterdir()) - set(captions))
    assert [path.name for path in films] == [name + suffix for name in NAMES]
    for caption in captions:
        words = caption.read_text(encoding='utf-8')
        assert len(words.split()) > 20, caption
    assert described in capsys.readouterr().err
    pytest.importorskip('av', reason='needs PyAV: pip install av')
    for path in films:
        assert frames_of(path, 320, 180) == 4


def test_a_film_has_the_requested_frames_and_rate(tmp_path):
    av: Any = pytest.importorskip('av', reason='needs PyAV: pip install av')
    path = tmp_path / f'film{MP4}'
    write_film(scene_of(resized(film_of('S6'), 322, 182, 7)), 25, path)
    assert frames_of(path, 322, 182) == 7
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ('h264', 'yuv420p')
        assert stream.average_rate == 25


def test_a_film_can_be_a_gif(tmp_path):
    path = tmp_path / 'film.gif'
    write_film(scene_of(resized(film_of('S8'), 320, 180, 6)), 25, path)
    with Image.open(path) as picture:
        assert (picture.size, getattr(picture, 'n_frames', 1)) == ((320, 180), 6)


def test_without_pyav_the_program_logs_it_and_halves_the_size(tmp_path, monkeypatch, capsys):
    made: list[Any] = []
    monkeypatch.setitem(sys.modules, 'av', None)
    monkeypatch.setattr(films_program, 'make_films', lambda *given: made.extend(given))
    assert main([str(CONFIG), '--output', str(tmp_path), '--quick', '--only', 'S6']) == 0
    said = capsys.readouterr().err
    assert 'GIF of half the size, because MP4 films need PyAV' in said
    (film,), _, suffix, _ = made
    assert (film.shape.width, film.shape.height, suffix) == (160, 90, GIF)


@pytest.mark.parametrize('name', NAMES)
def test_a_painted_frame_equals_a_drawn_frame_and_its_titles_fit(name):
    number = name.split('_')[0]
    shown = scene(number, 136) if number == 'S2' else scene(number)
    middle = len(shown.times) // 2
    with mpl.rc_context(STYLE):
        shown.show(middle)
        canvas = shown.figure.canvas
        canvas.draw()
        drawn = np.array(canvas.buffer_rgba()).astype(int)
        titles = [text.get_window_extent() for text in shown.figure.texts]
        first = np.array(shown.paint(0)).astype(int)
        painted = np.array(shown.paint(middle)).astype(int)
    # Moving artists are drawn on top, so the edges of a few letters may differ.
    assert painted.shape == (360, 640, 4)
    assert np.mean(np.abs(painted - drawn).max(axis=2) > 40) < 0.002
    assert np.mean(np.abs(painted - first).max(axis=2) > 40) > 0.005
    for n, box in enumerate(titles):
        assert 0 < box.x0 < box.x1 < 640
        assert 0 < box.y0 < box.y1 < 360
        assert not any(box.overlaps(other) for other in titles[n + 1 :])


@pytest.mark.parametrize('name', ['S3', 'S4', 'S5', 'S9'])
def test_a_cycle_ends_in_its_initial_state(name):
    cycle = scene(name)
    assert isinstance(cycle, (CycleScene, StaggeredScene))
    away = distance(cycle.angles, cycle.angles[0])
    assert away[-1] < 0.05
    assert away[1:-1].min() > 0.5


def test_gravity_moves_the_wall_to_the_lower_end_and_back():
    tilted = scene('S2', 136)
    assert isinstance(tilted, TiltScene)
    leans = np.sin(tilted.angles[:, 4:-4])
    right_end_low = np.searchsorted(tilted.times, 2.6)
    assert (leans[0] < -0.8).all()
    assert (leans[right_end_low] > 0.7).all()
    assert (leans[-1] < -0.7).all()


@pytest.mark.parametrize('name', ['S6', 'S7', 'S8'])
def test_a_unit_cell_keeps_its_bar_length_and_moves_at_constant_speed(name):
    cell, motion = scene(name, 161), film_of(name).motion
    assert isinstance(cell, CellScene)
    angles = staggered(cell.cell)
    assert np.abs(motion.chain.spring_extensions(angles)).max() < 1e-3 * motion.chain.rest_length
    speeds = np.linalg.norm(np.diff(angles, axis=0), axis=1) / cell.period
    expected = motion.kick * motion.chain.spacing
    expected /= motion.chain.rotor_length * motion.chain.time_unit
    assert speeds == pytest.approx(expected, rel=0.01)
    assert distance(angles[-1], angles[0]) < 1e-6


def test_a_drive_in_the_gap_decays_with_the_evanescent_wave_number():
    for share in [0.5, 0.8, 0.95]:
        chain = chain_of(WIDE_FLIPPER, 60)
        frequency = share * gap(chain)
        plus, minus = couplings(chain)
        # omega^2 = k_e / (M r^2) (q+^2 + q-^2 + 2 q+ q- cosh(kappa a)) for q+ q- < 0.
        square = (frequency * chain.rotor_length * chain.time_unit) ** 2
        decay = np.arccosh((square - plus**2 - minus**2) / (2 * plus * minus))
        motion = np.abs(driven(chain, frequency))
        assert motion[0] == pytest.approx(1)
        assert np.log(motion[5:14] / motion[6:15]) == pytest.approx(decay, rel=1e-6)


def test_a_driven_chain_obeys_its_equation_of_motion():
    chain = Chain(12, 0.1, 0.05, 0.5, damping=2e-5)
    frequency = 1.3 * gap(chain)
    motion = driven(chain, frequency)
    stiffness = stiffness_matrix(chain, chain.uniform_state(1))
    inertia = chain.moment_of_inertia * frequency**2 - 1j * chain.damping * frequency
    unbalanced = stiffness @ motion - inertia * motion
    assert np.abs(unbalanced[1:]).max() < 1e-10 * abs(unbalanced[0])


def test_the_profile_of_the_theory_is_that_of_a_wall_in_the_continuum():
    for crossed in [False, True]:
        for rotor in [59, 60]:
            for example in [(0.5, 0.05), (20.0, 1.0)]:
                chain = chain_of(example, 120)
                spinner = chain.motion is Motion.SPINNER
                # Walls of a spinner that starts at theta = +theta_bar.
                walls = [wall_between(chain, rotor, turned, crossed) for turned in (False, True)]
                starts = [np.cos(staggered(wall)[0] - chain.rest_angle) for wall in walls]
                angles = walls[int(np.argmax(starts))] if spinner else walls[0]
                positions = chain.spacing * np.arange(120)
                wall = chain.spacing * (rotor + 0.5)
                lean, _ = chain.positions(angles)
                limit = 1.5 * chain.spacing if spinner else 0.05 * lean.max()
                for parity in (0, 1):
                    theory = static_profile(chain, angles, wall, positions[parity::2], parity)
                    assert lean[parity::2] == pytest.approx(theory, rel=0, abs=limit)


@pytest.mark.parametrize('example', EXAMPLES)
def test_staggered_bodies_meet_only_where_they_are_joined(example):
    chain = chain_of(example, 6)
    bodies = layered(chain, wall_between(chain, 2), 0.02)
    rotors, _, pins, bars = np.split(bodies, [6, 12, 18])
    lengths = [np.linalg.norm(body[1] - body[0]) for body in (*rotors, *bars)]
    assert lengths == pytest.approx([chain.rotor_length] * 6 + [chain.rest_length] * 5)
    # Each rotor and bar has its own plane, and pins connect bar, rotor and bar.
    planes = [body[0, 1] for body in (*rotors, *bars)]
    assert len(np.unique(np.round(planes, 9))) == 11
    assert all(body[0, 1] == body[1, 1] for body in (*rotors, *bars))
    for n, bar in enumerate(bars):
        assert bar[0] == pytest.approx(pins[n][1])
        assert bar[1] == pytest.approx(pins[n + 1][0])
        assert pins[n].mean(axis=0) == pytest.approx(rotors[n][1])


def test_bodies_nearer_to_the_camera_are_painted_later():
    bodies = np.array([[[0, y, z], [1, y, z]] for y, z in ((0, 0), (1, 0), (0, 1))], dtype=float)
    assert from_behind(bodies, np.radians(-90), 0.0) == [1, 0, 2]
    assert from_behind(bodies, np.radians(90), 0.0) == [0, 2, 1]
    assert from_behind(bodies, np.radians(-90), np.radians(90))[-1] == 2


def test_invalid_settings_are_rejected_before_filming(tmp_path, capsys):
    for film, values, message in [
        (None, {'size': [1281, 720]}, 'size = [1281, 720] must be two even numbers of pixels'),
        (None, {'frame_rate': 0}, 'frame_rate = 0 must be a number in the range 1 to 120'),
        ('S3_flipper', {'kind': 'opera'}, "films.S3_flipper.kind = 'opera' must be one of cycle"),
        (
            'S3_flipper',
            {'speed': 1},
            'films.S3_flipper.speed = 1 is not known; known keys are chai',
        ),
        ('S2_tilted', {'times': [0, 2, 1]}, 'times = [0, 2, 1] must increase from 0; sort them'),
        ('S2_tilted', {'tilts': [0.1]}, 'tilts = [0.1] must be 6 numbers; give one for each time'),
        (
            'S1_insulator',
            {'drives': [1]},
            'drives = [1] must be two numbers; give one below 1 and',
        ),
        ('S9_staggered_spinner', {'depth': 0}, 'depth = 0 must be a number in the range 0.01'),
    ]:
        config = changed(tmp_path, film, **values)
        assert main([str(config), '--output', str(tmp_path / 'films')]) == 1
        said = capsys.readouterr().err
        assert said.startswith(f'films: {config}: ')
        assert message in said
        assert said.count('\n') == 1
        assert not (tmp_path / 'films').exists()


def test_a_unit_cell_has_two_rotors(tmp_path):
    chain = {'number_of_rotors': 3, 'rotor_length_ratio': 0.5, 'rest_angle': 0.97}
    settings = load_settings(changed(tmp_path, 'S6_flipper_cell', chain=chain))
    with pytest.raises(ValueError, match=r'chain\.number_of_rotors = 3 must be 2'):
        read_films(settings)


def test_a_failed_film_stops_all_films_and_leaves_no_files(tmp_path, capsys):
    # No program writes files of this kind, so every film fails.
    with pytest.raises(ValueError, match='unknown file extension'):
        make_films([resized(film, 320, 180, 3) for film in ALL[5:8]], tmp_path, '.none', 1)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / 'taken').write_text('', encoding='utf-8')
    assert main([str(CONFIG), '--output', str(tmp_path / 'taken'), '--quick']) == 1
    assert re.search(r'films: .*taken', capsys.readouterr().err)


def test_an_interrupted_run_leaves_no_partial_files(tmp_path):
    program = 'from soliton_linkage_studies.films.program import main; raise SystemExit(main())'
    command = [sys.executable, '-c', program, str(CONFIG)]
    process = subprocess.Popen(
        [*command, '--only', 'S6', '--workers', '1', '--output', str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not list(tmp_path.glob('.unfinished-*/*')):
        assert process.poll() is None
        time.sleep(0.05)
    # A terminal sends Ctrl-C to all processes of the group.
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert 'Traceback' not in said
    assert list(tmp_path.iterdir()) == []


OWN_FILM = """
from soliton_linkage_studies.films.scenes import FILM_KINDS
from soliton_linkage_studies.films.scenes import Scene


class Seconds:
    @staticmethod
    def read(section):
        section.check_keys('seconds')
        return section.number('seconds', 1.0, 10.0)


@FILM_KINDS.add('dot')
class DotScene(Scene):
    settings = Seconds

    def __init__(self, title, seconds, shape):
        super().__init__(title, 'a dot', shape, seconds, 1.0)
        (self._dot,) = self.figure.add_subplot().plot([0], [0], 'o')
        self.add_moving([self._dot])

    def _move(self, frame):
        self._dot.set_data([self.times[frame]], [0])
"""


def test_an_external_kind_of_film_is_made_with_the_others(tmp_path, monkeypatch):
    (tmp_path / 'own_film.py').write_text(OWN_FILM, encoding='utf-8')
    film = {'kind': 'dot', 'title': 'A dot', 'playing_time': 1, 'seconds': 2.0}
    config = changed(tmp_path, films={'D1_dot': film})
    output = tmp_path / 'out'
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module('own_film')
    try:
        assert main([str(config), '--output', str(output), '--quick', '--only', 'D1']) == 0
    finally:
        del FILM_KINDS['dot'], sys.modules['own_film']
    assert {path.name for path in output.iterdir()} == {
        f'D1_dot{file_kind()[0]}',
        'D1_dot.txt',
    }
