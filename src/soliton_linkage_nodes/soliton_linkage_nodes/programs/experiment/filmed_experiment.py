# SPDX-License-Identifier: Apache-2.0
"""Filmed experiment: film a simulated chain, identify its lengths, and track its soliton.

The lengths of the rotors, spacings and springs deviate from the known nominal values.
"""

from __future__ import annotations

import html
import json
import math
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.estimation import Analyser, Analysis
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import described_fields, quantity
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.progress import ProgressLine
from soliton_linkage.vision.video import TimedPicture, read_video, write_video
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.messages.camera_measurement import CameraMeasurement, CameraParameters
from soliton_linkage_nodes.messages.chain_source import chain_of_file, markers_of_file
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.messages.picture_conversions import read_camera, write_camera
from soliton_linkage_nodes.programs.analyse_bag import analyse
from soliton_linkage_nodes.programs.bag_analysis import analyse_frames
from soliton_linkage_nodes.programs.film_encoders import FilmSummary, film_to_bag
from soliton_linkage_nodes.programs.identify_chain import identify_bags, summary
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_studies.camera.runs import CAMERA, BenchParameters, FilmedBench

_DEVIATIONS = interfaces.JOINT_STATE_DEVIATIONS.name
_print = partial(print, flush=True)
_FROM_EDGES = 4.0
"""The position errors do not include frames in which the soliton is closer to an edge of the
chain than this [rotor spacings]."""


@dataclass(frozen=True)
class PositionErrors:
    """Errors of the angles and of the soliton position in a film.

    Position errors are root mean squares [rotor spacings] over the frames in which the soliton is
    not near an edge of the chain.
    """

    angle_noise: float
    """Standard deviation of the angle errors, after the mean error of each rotor is subtracted
    [rad]."""
    stated_angle_noise: float
    """Median of the standard deviations that the camera measurement reports for the angles
    [rad]."""
    frames: int
    error: float
    """Error of the position that an analyser with the identified chain estimates."""
    stated: float
    """Standard deviation that the analyser with the identified chain states for the position."""
    allowed: float
    """Cramer-Rao bound of the position error for one frame in which all rotors are visible and the
    angles have the noise `angle_noise`."""
    with_true_chain: float
    """Error of the position that an analyser with the true chain estimates."""
    hidden: float
    """Fraction of the angles that were hidden from the camera in the frames of the position errors
    [1]."""
    by_hidden: float
    """Error of the position that an analyser with the true chain estimates from the exact angles
    of the visible rotors. Only the hidden rotors cause this error."""


@dataclass(frozen=True)
class FilmedExperimentParameters(BenchParameters):
    """Parameters of the experiment."""

    scenario: str = quantity('filmed', 'name of the experiment')


def run(configuration: Path, given: Mapping[str, Any], folder: Path) -> str:
    """Run the filmed experiment of a configuration file, and return its result as text.

    The file supplies the chain and its markers. `given` contains the parameters in the section
    filmed_experiment of the file; the other parameters have their default values. The results are
    written to `folder`. Raises ValueError if a parameter is unknown or out of range.
    """
    known = described_fields(FilmedExperimentParameters)
    for name, value in given.items():
        if name not in known:
            raise ValueError(
                f'{configuration}: unknown parameter {name}; the parameters are {", ".join(known)}'
            )
        complaint = known[name].complaint(value)
        if complaint is not None:
            raise ValueError(f'{configuration}: {name} = {value!r} {complaint}')
    parameters = FilmedExperimentParameters(**given)
    errors = FilmedExperiment(configuration, parameters, folder).run()
    return describe_errors(errors, parameters.spread)


class FilmedExperiment:
    """Experiment that films a chain, identifies it, and tracks its soliton."""

    def __init__(self, configuration: Path, parameters: BenchParameters, output: Path) -> None:
        self._plan = chain_of_file(configuration)
        self._markers = markers_of_file(configuration)
        self._bench = FilmedBench(self._plan.chain, self._markers, parameters)
        self._folder = output

    def run(self) -> PositionErrors:
        """Run all steps, write the page and summary.json, and return the measured errors."""
        film, lens = self._folder / 'film.mp4', self._folder / 'camera.yaml'
        self._film(film)
        write_camera(lens, CAMERA)
        seen = self._seen(film, lens, self._plan, 'seen')
        _print(
            f'Measured {seen.shares:.1%} of the angles in {seen.pictures} pictures, with a '
            f'standard deviation of {1e3 * seen.deviation:.2g} mrad.'
        )
        _print('Identifying the chain from the angles; this is the longest step.')
        found = identify_bags([seen.bag], self._folder)
        _print(summary(found))
        identified = chain_of_file(self._folder / 'chain.yaml')
        overlay = self._folder / 'overlay.mp4'
        again = self._seen(film, lens, identified, 'identified', overlay)
        analyse(again.bag, self._folder, identified)
        errors = self._errors(again.bag, identified)
        write_film_page(self._folder, describe_errors(errors, self._bench.parameters.spread))
        text = json.dumps(asdict(errors), indent=2) + '\n'
        (self._folder / 'summary.json').write_text(text, encoding='utf-8')
        return errors

    def _film(self, path: Path) -> None:
        pictures = self._bench.pictures
        _print(
            f'Filming a chain of {self._plan.rotors} rotors, whose lengths deviate by '
            f'{self._bench.parameters.spread:.0%}.'
        )
        progress = ProgressLine('filming', pictures)

        def shown() -> Iterator[TimedPicture]:
            for count, shot in enumerate(self._bench.film(), start=1):
                progress.show(count, f'{count} pictures')
                yield shot

        write_video(path, shown(), alone=True)
        progress.clear()

    def _seen(
        self, film: Path, lens: Path, named: NamedChain, name: str, overlay: Path | None = None
    ) -> FilmSummary:
        camera = CameraParameters(CAMERA.row_time, CAMERA.exposure)
        measurement = CameraMeasurement(named, self._markers, camera, read_camera(lens))
        for earlier in self._folder.glob(f'{name}_*'):
            shutil.rmtree(earlier)
        return film_to_bag(read_video(film), named, measurement, self._folder / name, overlay)

    def _errors(self, bag: Path, identified: NamedChain) -> PositionErrors:
        with open_bag(bag) as reader:
            deviations = np.array([each.position for _, each in read_topic(reader, _DEVIATIONS)])
            frames = list(analyse_frames(reader, identified))
        found = np.array([_position(analysis) for _, analysis in frames])
        angles = np.array([joints.position for joints, _ in frames])
        stamps = np.array([joints.stamp for joints, _ in frames])
        times = (stamps - stamps[0]) / SECOND
        exact = self._bench.angles(times)
        true = _positions(self._bench.chain, times, exact)[:, 0]
        informed = _positions(self._bench.chain, times, angles)[:, 0]
        shown = np.where(np.isnan(angles), np.nan, exact)
        partly = _positions(self._bench.chain, times, shown)[:, 0]
        last = self._bench.chain.number_of_rotors - 1
        inside = np.isfinite(true) & np.isfinite(found[:, 0]) & np.isfinite(informed)
        inside &= (true > _FROM_EDGES) & (true < last - _FROM_EDGES)
        if not inside.any():
            remedy = 'raise the parameter kick or duration'
            raise ValueError(f'no soliton was tracked in the film; {remedy}')
        errors = angles - exact
        noise = float(np.nanstd(errors - np.nanmean(errors, axis=0)))
        orbit = orbit_of(self._bench.chain)
        arcs = [orbit.site_arc_at(orbit.arc_at(float(site), 0)) for site in true[inside]]
        return PositionErrors(
            noise,
            float(np.nanmedian(deviations)),
            int(inside.sum()),
            _rms(found[inside, 0] - true[inside]),
            _rms(found[inside, 1] / self._bench.chain.spacing),
            _rms(noise / np.array(arcs)),
            _rms(informed[inside] - true[inside]),
            float(np.isnan(angles[inside]).mean()),
            _rms((partly - true)[inside & np.isfinite(partly)]),
        )


def describe_errors(errors: PositionErrors, spread: float) -> str:
    """Describe the result in a text of several sentences.

    `spread` is the standard deviation of the true lengths from their design values, divided by the
    design values [1].
    """
    hidden = (
        f'{errors.hidden:.1%} of the rotors were hidden, which alone causes an error of '
        f'{errors.by_hidden:.2g}.'
        if errors.hidden
        else 'No rotor was hidden.'
    )
    return (
        f'The angles have a noise of {1e3 * errors.angle_noise:.2g} mrad. In {errors.frames} '
        f'pictures the rms error of the soliton position is {errors.error:.2g} rotor spacings '
        f'with the chain that was identified from the film, and {errors.with_true_chain:.2g} with '
        f'the true chain, whose lengths deviate by {spread:.0%}. With this noise and all rotors '
        f'visible, the Cramer-Rao bound for one picture is {errors.allowed:.2g}. {hidden}'
    )


def _positions(chain: Chain, times: Array, angles: Array) -> Array:
    analyser, frames = Analyser(chain), zip(times, angles, strict=True)
    analyses = [analyser.analyse(round(time * SECOND), of_frame) for time, of_frame in frames]
    return np.array([_position(each) for each in analyses])


def _position(analysis: Analysis | None) -> tuple[float, float]:
    if analysis is None or len(analysis.solitons) != 1:
        return math.nan, math.nan
    (soliton,) = analysis.solitons
    return soliton.rotor, soliton.position_deviation


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


_PAGE = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>A soliton in a film</title>
<style>
body {{ font-family: sans-serif; margin: 1em; color: #3a3a3a; }}
main {{
  display: grid; gap: 1em;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 30em), 1fr));
}}
figure {{ margin: 0; }}
video, img {{ width: 100%; }}
</style>
<h1>A soliton in a film</h1>
<p>{text}</p>
<main>{figures}</main>
<script>
// Both films show the same instant.
const films = document.querySelectorAll('video');
for (const film of films) for (const event of ['play', 'pause', 'seeked'])
  film.addEventListener(event, () => {{
    for (const other of films) if (other !== film) {{
      if (Math.abs(other.currentTime - film.currentTime) > 0.05)
        other.currentTime = film.currentTime;
      if (event === 'play') other.play(); else if (event === 'pause') other.pause();
    }}
  }});
</script>
</html>
"""
_FIGURES = (
    ('film.mp4', 'The film of the camera.'),
    ('overlay.mp4', 'The film with the detected markers and the soliton.'),
    ('identification.png', 'The identified chain: its lengths, and the residuals of its bonds.'),
    ('track.png', 'Position and velocity of the soliton on the identified chain.'),
)


def write_film_page(folder: Path, text: str) -> None:
    """Write index.html, which shows the result `text` and the films and pictures in a folder."""
    video, image = '<video src="{}" controls muted loop></video>', '<img src="{}" alt="">'
    figures = ''.join(
        f'<figure>{(video if name.endswith(".mp4") else image).format(name)}'
        f'<figcaption>{html.escape(caption)}</figcaption></figure>'
        for name, caption in _FIGURES
    )
    page = _PAGE.format(text=html.escape(text), figures=figures)
    (folder / 'index.html').write_text(page, encoding='utf-8')
