# SPDX-License-Identifier: Apache-2.0
"""Films have the frames that they are asked for, show the motion, and appear whole or not."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
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

from soliton_linkage.linear.bands import couplings, gap
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Chain, Motion, staggered
from soliton_linkage.studies.films import program
from soliton_linkage.studies.films.cell import CellScene, StaggeredScene, from_behind, layered
from soliton_linkage.studies.films.chain import CycleScene, TiltScene, driven
from soliton_linkage.studies.films.files import FileKind, file_kind
from soliton_linkage.studies.films.program import (
    Film,
    chosen,
    main,
    make_films,
    read_films,
    resized,
    scene_of,
)
from soliton_linkage.studies.films.scenes import STYLE, static_profile
from soliton_linkage.studies.settings import load_settings

CONFIG = Path(__file__).parents[4] / 'config/studies/films.yaml'
GIF = FileKind('', 'a test')
ALL = read_films(load_settings(CONFIG))
NAMES = [film.name for film in ALL]


def changed(folder: Path, film: str | None = None, **values: object) -> Path:
    """Write the settings with other values in a film, or at the top; None removes a key."""
    content: Any = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    section = content['films'][film] if film else content
    for key, value in values.items():
        section.pop(key, None)
        if value is not None:
            section[key] = value
    path = folder / 'films.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return path


def frames_of(path: Path, ffmpeg: str, width: int, height: int) -> float:
    """Number of frames of a film that has a size [pixels], decoded one and all."""
    command = [ffmpeg, '-v', 'error', '-i', str(path)]
    command += ['-f', 'rawvideo', '-pix_fmt', 'rgb24', '-fps_mode', 'passthrough', '-']
    decoded = subprocess.run(command, capture_output=True, check=True, timeout=60)
    assert decoded.stderr == b''
    return len(decoded.stdout) / (3 * width * height)


@pytest.mark.parametrize('module', ['figures', 'films', 'sweep'])
def test_each_study_is_a_command(module: str) -> None:
    command = [sys.executable, '-m', f'soliton_linkage.studies.{module}', '--help']
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert shown.stdout.startswith(f'usage: {module} ')
    assert '--workers' in shown.stdout
    assert shown.stderr == ''


def test_films_are_made_by_as_many_processes_as_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = []
    processes = program.local_processes

    def counted(count: int, *rest: Any) -> Any:
        counts.append(count)
        return processes(count, *rest)

    monkeypatch.setattr(program, 'local_processes', counted)
    command = [str(CONFIG), '--output', str(tmp_path), '--quick', '--only', 'S6', 'S7']
    for workers in ('1', '2', '5'):
        assert main([*command, '--workers', workers]) == 0
    assert counts == [1, 2, 2]


@pytest.mark.parametrize('count', ['0', '-1', 'two', '1001'])
def test_workers_are_counted(count: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(['any.yaml', f'--workers={count}'])
    assert f"'{count}' must be a whole number from 1 to 1000" in capsys.readouterr().err


def test_the_projections_of_a_tilted_linkage_are_those_of_its_rotors() -> None:
    with mpl.rc_context(STYLE):
        scene = scene_of(resized(chosen(ALL, ['S2'])[0], 320, 180, 9))
    assert isinstance(scene, TiltScene)
    (strip,) = (each for each in scene.figure.axes if each.get_title('left').startswith('u = '))
    (arrows,) = (each for each in strip.collections if isinstance(each, Quiver))
    for frame in (0, 4, 8):
        scene.show(frame)
        chain = chosen(ALL, ['S2'])[0].motion.chain
        expected = chain.rotor_length * np.sin(scene.angles[frame])
        assert np.asarray(arrows.U) == pytest.approx(expected)
        assert np.asarray(arrows.get_array()) == pytest.approx(expected)


def test_the_papers_movies_are_all_there() -> None:
    assert [name.split('_')[0] for name in NAMES] == [f'S{n}' for n in range(1, 10)]
    assert {film.kind for film in ALL} == set(program._KINDS)


def test_a_quick_run_makes_nine_playable_films(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / 'new' / 'films'
    assert main([str(CONFIG), '--output', str(output), '--quick']) == 0
    kind = file_kind()
    assert sorted(path.name for path in output.iterdir()) == [name + kind.suffix for name in NAMES]
    assert kind.reason in capsys.readouterr().err
    if not kind.ffmpeg:
        pytest.skip('no ffmpeg to read the films with')
    for path in output.iterdir():
        assert frames_of(path, kind.ffmpeg, 320, 180) == 4


@pytest.mark.parametrize('frames', [2, 7])
def test_a_film_has_as_many_frames_as_it_is_asked_for(tmp_path: Path, frames: int) -> None:
    kind = file_kind()
    if not kind.ffmpeg:
        pytest.skip('no ffmpeg to write MP4 with')
    film = resized(chosen(ALL, ['S6'])[0], 322, 182, frames)
    make_films([film], tmp_path, kind)
    assert frames_of(tmp_path / f'{film.name}.mp4', kind.ffmpeg, 322, 182) == frames
    shown = subprocess.run(
        [kind.ffmpeg, '-hide_banner', '-i', str(tmp_path / f'{film.name}.mp4')],
        capture_output=True,
        text=True,
        check=False,
    ).stderr
    assert re.search(r'Video: h264.*yuv420p.*322x182', shown)
    assert '25 fps' in shown


def test_without_ffmpeg_a_film_is_a_gif(tmp_path: Path) -> None:
    film = resized(chosen(ALL, ['S8'])[0], 320, 180, 6)
    make_films([film], tmp_path, GIF)
    with Image.open(tmp_path / f'{film.name}.gif') as picture:
        assert (picture.size, getattr(picture, 'n_frames', 1)) == ((320, 180), 6)


def test_without_ffmpeg_the_program_says_so_and_halves_the_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('shutil.which', lambda _: None)
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    assert main([str(CONFIG), '--output', str(tmp_path), '--quick', '--only', 'S6']) == 0
    said = capsys.readouterr().err
    assert 'GIF of half the size, because there is no command ffmpeg and no package' in said
    with Image.open(tmp_path / 'S6_flipper_cell.gif') as picture:
        assert picture.size == (160, 90)


def test_an_ffmpeg_that_cannot_write_h264_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    poor = tmp_path / 'ffmpeg'
    poor.write_text('#!/bin/sh\necho " V....D mpeg4"\n', encoding='utf-8')
    poor.chmod(0o755)
    monkeypatch.setattr('shutil.which', lambda _: str(poor))
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    kind = file_kind()
    assert kind.suffix == '.gif'
    assert f'no libx264 in {poor}' in kind.reason


@pytest.mark.parametrize('film', ALL, ids=NAMES)
def test_a_painted_frame_is_a_drawn_one_and_its_titles_fit(film: Film) -> None:
    with mpl.rc_context(STYLE):
        scene = scene_of(resized(film, 640, 360, 7))
        scene.show(3)
        canvas: Any = scene.figure.canvas
        canvas.draw()
        drawn = np.array(canvas.buffer_rgba()).astype(int)
        titles = [text.get_window_extent() for text in scene.figure.texts]
        first = np.array(scene.paint(0)).astype(int)
        painted = np.array(scene.paint(3)).astype(int)
    # Moving artists lie above all others, so that edges of a few letters may differ.
    assert painted.shape == (360, 640, 4)
    assert np.mean(np.abs(painted - drawn).max(axis=2) > 40) < 0.002
    assert np.mean(np.abs(painted - first).max(axis=2) > 40) > 0.005
    for n, box in enumerate(titles):
        assert 0 < box.x0 < box.x1 < 640
        assert 0 < box.y0 < box.y1 < 360
        assert not any(box.overlaps(other) for other in titles[n + 1 :])


@pytest.mark.parametrize('name', ['S3', 'S4', 'S5', 'S9'])
def test_a_cycle_ends_where_it_began(name: str) -> None:
    scene = scene_of(resized(chosen(ALL, [name])[0], 320, 180, 21))
    assert isinstance(scene, (CycleScene, StaggeredScene))
    away = distance(scene.angles, scene.angles[0])
    assert away[-1] < 0.05
    assert away[1:-1].min() > 0.5


def test_gravity_takes_the_rotors_to_the_lower_end_and_back() -> None:
    film = chosen(ALL, ['S2'])[0]
    scene = scene_of(resized(film, 320, 180, 136))
    assert isinstance(scene, TiltScene)
    leans = np.sin(scene.angles[:, 4:-4])
    right_end_low = np.searchsorted(scene.times, 2.6)
    assert (leans[0] < -0.8).all()
    assert (leans[right_end_low] > 0.7).all()
    assert (leans[-1] < -0.7).all()


@pytest.mark.parametrize('name', ['S6', 'S7', 'S8'])
def test_a_unit_cell_keeps_its_bar_and_goes_round_at_an_even_pace(name: str) -> None:
    film = chosen(ALL, [name])[0]
    scene = scene_of(resized(film, 320, 180, 161))
    assert isinstance(scene, CellScene)
    angles = staggered(scene.cell)
    extensions = film.motion.chain.spring_extensions(angles)
    assert np.abs(extensions).max() < 1e-3 * film.motion.chain.rest_length
    speeds = np.linalg.norm(np.diff(angles, axis=0), axis=1) / scene.period
    expected = film.motion.kick * film.motion.chain.spacing
    expected /= film.motion.chain.rotor_length * film.motion.chain.time_unit
    assert speeds == pytest.approx(expected, rel=0.01)
    assert distance(angles[-1], angles[0]) < 1e-6


@pytest.mark.parametrize('share', [0.5, 0.8, 0.95])
def test_a_drive_in_the_gap_dies_out_as_the_dispersion_says(share: float) -> None:
    chain = chain_of(WIDE_FLIPPER, 60)
    frequency = share * gap(chain)
    plus, minus = couplings(chain)
    # omega^2 = k_e / (M r^2) (q+^2 + q-^2 + 2 q+ q- cosh(kappa a)) for q+ q- < 0.
    square = (frequency * chain.rotor_length * chain.time_unit) ** 2
    decay = np.arccosh((square - plus**2 - minus**2) / (2 * plus * minus))
    motion = np.abs(driven(chain, frequency))
    assert motion[0] == pytest.approx(1)
    assert np.log(motion[5:14] / motion[6:15]) == pytest.approx(decay, rel=1e-6)


def test_a_driven_chain_obeys_its_equation_of_motion() -> None:
    chain = Chain(12, 0.1, 0.05, 0.5, damping=2e-5)
    frequency = 1.3 * gap(chain)
    motion = driven(chain, frequency)
    stiffness = stiffness_matrix(chain, chain.uniform_state(1))
    inertia = chain.moment_of_inertia * frequency**2 - 1j * chain.damping * frequency
    unbalanced = stiffness @ motion - inertia * motion
    assert np.abs(unbalanced[1:]).max() < 1e-10 * abs(unbalanced[0])


@pytest.mark.parametrize('example', [(0.5, 0.05), (20.0, 1.0)])
@pytest.mark.parametrize('rotor', [59, 60])
@pytest.mark.parametrize('crossed', [False, True])
def test_the_profile_of_the_theory_is_that_of_a_wall_in_the_continuum(
    example: tuple[float, float], rotor: int, crossed: bool
) -> None:
    chain = chain_of(example, 120)
    spinner = chain.motion is Motion.SPINNER
    # The walls of a spinner that started in theta = +theta_bar.
    walls = [wall_between(chain, rotor, turned, crossed) for turned in (False, True)]
    starts = [np.cos(staggered(wall)[0] - chain.rest_angle) for wall in walls]
    angles = walls[int(np.argmax(starts))] if spinner else walls[0]
    places = chain.spacing * np.arange(120)
    wall = chain.spacing * (rotor + 0.5)
    lean, _ = chain.positions(angles)
    limit = 1.5 * chain.spacing if spinner else 0.05 * lean.max()
    for parity in (0, 1):
        theory = static_profile(chain, angles, wall, places[parity::2], parity)
        assert lean[parity::2] == pytest.approx(theory, rel=0, abs=limit)


@pytest.mark.parametrize('example', EXAMPLES)
def test_staggered_bodies_meet_only_where_they_are_joined(example: tuple[float, float]) -> None:
    chain = chain_of(example, 6)
    bodies = layered(chain, wall_between(chain, 2), 0.02)
    rotors, _, pins, bars = np.split(bodies, [6, 12, 18])
    lengths = [np.linalg.norm(body[1] - body[0]) for body in (*rotors, *bars)]
    assert lengths == pytest.approx([chain.rotor_length] * 6 + [chain.rest_length] * 5)
    # Rotors and bars have a plane each, and pins reach from bar to rotor to bar.
    planes = [body[0, 1] for body in (*rotors, *bars)]
    assert len(np.unique(np.round(planes, 9))) == 11
    assert all(body[0, 1] == body[1, 1] for body in (*rotors, *bars))
    for n, bar in enumerate(bars):
        assert bar[0] == pytest.approx(pins[n][1])
        assert bar[1] == pytest.approx(pins[n + 1][0])
        assert pins[n].mean(axis=0) == pytest.approx(rotors[n][1])


def test_what_is_nearer_to_the_camera_is_painted_later() -> None:
    bodies = np.array([[[0, y, z], [1, y, z]] for y, z in ((0, 0), (1, 0), (0, 1))], dtype=float)
    assert from_behind(bodies, np.radians(-90), 0.0) == [1, 0, 2]
    assert from_behind(bodies, np.radians(90), 0.0) == [0, 2, 1]
    assert from_behind(bodies, np.radians(-90), np.radians(90))[-1] == 2


@pytest.mark.parametrize(
    ('film', 'values', 'message'),
    [
        (None, {'size': [1281, 720]}, 'size = [1281, 720] must be two even numbers of pixels'),
        (None, {'frame_rate': 0}, 'frame_rate = 0 must be a number in the range 1 to 120'),
        (None, {'films': None}, 'films is missing; give a section of keys'),
        (None, {'fps': 3}, 'fps = 3 is not known; it may hold frame_rate, size, films'),
        ('S3_flipper', {'kind': 'opera'}, "films.S3_flipper.kind = 'opera' must be one of insul"),
        ('S3_flipper', {'title': None}, 'films.S3_flipper.title is missing; give a text'),
        ('S3_flipper', {'kick': '1e-1'}, "S3_flipper.kick = '1e-1' must be a number in the rang"),
        ('S3_flipper', {'speed': 1}, 'films.S3_flipper.speed = 1 is not known; it may hold chai'),
        ('S3_flipper', {'chain': 3}, 'films.S3_flipper.chain = 3 must be a section; indent'),
        ('S2_tilted', {'times': [0, 2, 1]}, 'times = [0, 2, 1] must increase from 0; sort them'),
        ('S2_tilted', {'tilts': [0.1]}, 'tilts = [0.1] must be 6 numbers; give one a time'),
        ('S1_insulator', {'drives': [1]}, 'drives = [1] must be two numbers; give one each side'),
        ('S9_staggered_spinner', {'depth': 0}, 'depth = 0 must be a number in the range 0.01'),
    ],
)
def test_bad_settings_are_refused_before_anything_is_filmed(
    film: str | None,
    values: dict[str, object],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = changed(tmp_path, film, **values)
    assert main([str(config), '--output', str(tmp_path / 'films')]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f'films: {config}: ')
    assert message in said
    assert said.count('\n') == 1
    assert not (tmp_path / 'films').exists()


def test_a_unit_cell_has_two_rotors(tmp_path: Path) -> None:
    chain = {'number_of_rotors': 3, 'rotor_length_ratio': 0.5, 'rest_angle': 0.97}
    settings = load_settings(changed(tmp_path, 'S6_flipper_cell', chain=chain))
    with pytest.raises(ValueError, match=r'chain\.number_of_rotors = 3 must be 2'):
        read_films(settings)


def test_films_are_chosen_by_their_number_or_name() -> None:
    assert chosen(ALL, []) == ALL
    assert [film.name for film in chosen(ALL, ['S5', 'S3_flipper'])] == [NAMES[2], NAMES[4]]
    with pytest.raises(ValueError, match=r'--only S33: there is no such film; there are S1_ins'):
        chosen(ALL, ['S3', 'S33'])


def test_a_film_that_fails_ends_all_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # No ffmpeg is there, so that every film fails once its first frame is written.
    broken = FileKind(str(tmp_path / 'absent'), 'a test')
    with pytest.raises(FileNotFoundError):
        make_films([resized(film, 320, 180, 3) for film in ALL[5:8]], tmp_path, broken)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / 'taken').write_text('', encoding='utf-8')
    assert main([str(CONFIG), '--output', str(tmp_path / 'taken'), '--quick']) == 1
    assert re.search(r'films: .*taken', capsys.readouterr().err)


@pytest.mark.parametrize(('number', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_ends_at_once_and_leaves_nothing_half_written(
    number: signal.Signals, code: int, tmp_path: Path
) -> None:
    command = (
        'import sys; from soliton_linkage.studies.films.program import main; sys.exit(main())'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', command, str(CONFIG), '--output', str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    begun = time.monotonic()
    while not list(tmp_path.glob('.unfinished-*/*')):
        assert process.poll() is None
        assert time.monotonic() - begun < 100
        time.sleep(0.05)
    sent = time.monotonic()
    # As a terminal does it, Ctrl-C goes to all processes of the group.
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == code
    assert time.monotonic() - sent < 20
    assert 'Traceback' not in said
    assert list(tmp_path.iterdir()) == []
