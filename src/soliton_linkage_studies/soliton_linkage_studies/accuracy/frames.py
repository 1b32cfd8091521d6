# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo study of the single-frame estimators: table and pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.accuracy.estimators import (
    EstimatorTrial,
    bias_by_position,
    bound,
    errors,
    estimators_of,
    inner_positions,
)
from soliton_linkage_studies.accuracy.pictures import draw_accuracy, draw_bias
from soliton_linkage_studies.accuracy.statistics import Line, accuracy_of, write_lines
from soliton_linkage_studies.settings import Section, chain_from

_CHUNK = 250
"""Number of frames per task [1]; each task has its own random seed."""


@dataclass(frozen=True)
class FrameStudy:
    """Study of estimators: chains, noise and number of frames."""

    chains: tuple[Chain, ...]
    noises: tuple[float, ...]
    """Tested standard deviations of the noise of each angle [rad]."""
    trial: EstimatorTrial
    """Parameters of the tested frames; the noise is replaced by each of `noises`."""
    seed: int

    def tasks(self) -> list[Callable[[], Any]]:
        """Return one task per chunk of frames, then one task per chain for the bias."""
        cells = product(range(len(self.chains)), range(len(self.noises)), range(self._chunks))
        return [
            *(partial(self.sample, *numbers) for numbers in cells),
            *(partial(bias_by_position, chain, 81) for chain in self.chains),
        ]

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write tables and pictures; `results` are the results of the tasks in order."""
        biases = list(zip(self.chains, results[-len(self.chains) :], strict=True))
        lines = self.lines(results[: -len(self.chains)])
        write_lines(lines, folder)
        draw_accuracy(lines).save(folder, 'single_frame')
        draw_bias(biases).save(folder, 'bias_by_position')

    def sample(self, chain: int, noise: int, chunk: int) -> dict[str, Array]:
        """Return `errors` for a chunk; the arguments are indices of chain, noise and chunk."""
        frames = min(_CHUNK, self.trial.frames - chunk * _CHUNK)
        trial = replace(self.trial, frames=frames, noise=self.noises[noise])
        generator = np.random.default_rng([self.seed, chain, noise, chunk])
        return errors(self.chains[chain], trial, generator)

    def lines(self, samples: Sequence[dict[str, Array]]) -> list[Line]:
        """Return the table rows from the results of `sample`, in the order of `tasks`."""
        lines = []
        cells = list(product(self.chains, self.noises))
        for cell, (chain, noise) in enumerate(cells):
            chunks = samples[cell * self._chunks : (cell + 1) * self._chunks]
            for name in estimators_of(chain):
                pairs = np.concatenate([chunk[name] for chunk in chunks])
                lines.append(Line(chain, noise, name, accuracy_of(pairs, bound(chain, noise))))
        return lines

    @property
    def _chunks(self) -> int:
        return math.ceil(self.trial.frames / _CHUNK)


def read_frame_study(section: Section, quick: bool) -> FrameStudy:
    """Read the settings. Raises ValueError for invalid settings."""
    values = section.values_of(EstimatorTrial, 'chains', 'noises', 'seed')
    trial = EstimatorTrial(math.nan, **values)
    if quick:
        trial = replace(trial, frames=min(trial.frames, 400))
    chains = tuple(_chain_of(each) for each in section.sections('chains').values())
    noises, seed = section.numbers('noises', 1e-9, 1.0), section.whole_number('seed', 0, 2**32)
    return FrameStudy(chains, noises, trial, seed)


def _chain_of(section: Section) -> Chain:
    chain = chain_from(section)
    low, high = inner_positions(chain)
    if low >= high:
        fewest = math.floor(2 * low) + 2
        raise section.error(
            'number_of_rotors',
            f'leaves no position at a distance of two wall widths ({low:.3g} spacings) from both '
            f'edges; use {fewest} or more',
        )
    return chain
