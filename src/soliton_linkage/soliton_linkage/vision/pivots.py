# SPDX-License-Identifier: Apache-2.0
"""Where the pivots of a chain are, by the mean of their dots over all pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.layout import MarkerLayout

_BESIDE = 0.25
"""Of the spacing by which pivots may be beside their line, as frames are glued [1]."""
_OFF = 0.4
"""By which distances of pivots may differ from multiples of the spacing, over it [1]."""
_LEAST_SHARE = 0.8
"""Of the pivots that must have been seen before they are numbered [1]."""
_MOST_AVERAGED = 1000
"""Pictures that a mean is of, so that a bench that settles slowly is followed [1]."""
_LIKE_BLACK = 4.0
"""Cost of the colour up to which a dot is black [1]: that of two standard deviations."""


class Pivots:
    """Finds the pivots, once most were seen, and goes on to average them and to find others."""

    def __init__(self, layout: MarkerLayout) -> None:
        """Know none yet."""
        chain = layout.chain
        self.known = np.zeros(chain.number_of_rotors, dtype=bool)
        """Which pivots are known, shape (N,): most are, or none."""
        self.places = np.column_stack([chain.pivots, np.zeros(chain.number_of_rotors)])
        """Of the pivots [m], shape (N, 2): told ones, or between those that are known."""
        self.found = 0
        """How many dots have been found that may be pivots."""
        self._layout = layout
        self._spots = np.zeros((0, 2))
        self._counts = np.zeros(0)

    def look(self, places: Array, colour_costs: Array) -> None:
        """Take what dots of a picture show: places at both heights [m], (2, K, 2), and colours."""
        black = colour_costs[:, 0] <= _LIKE_BLACK
        if self.known.any():
            self._average(places[:, black])
        else:
            self._collect(places[0, black])

    def _average(self, places: Array) -> None:
        if not places.shape[1]:
            return
        rotors = np.arange(len(self.places))
        apart = np.hypot(*(places[rotors % 2] - self.places[:, None]).transpose(2, 0, 1))
        nearest = np.argmin(apart, axis=1)
        spacing, same = self._layout.chain.spacing, self._layout.dot_radius / 2
        seen = apart[rotors, nearest] < np.where(self.known, same, _BESIDE * spacing)
        self._counts[seen] = np.minimum(self._counts[seen] + 1, _MOST_AVERAGED)
        shift = places[rotors % 2, nearest] - self.places
        self.places[seen] += shift[seen] / self._counts[seen, None]
        self.known |= seen

    def _collect(self, places: Array) -> None:
        """Keep dots near the line of the pivots, and find the pivots among them."""
        spacing = self._layout.chain.spacing
        ends = self.places[0, 0] - spacing / 2, 2 * self.places[-1, 0] - self.places[0, 0]
        near = np.abs(places[:, 1]) < _BESIDE * spacing
        near &= (places[:, 0] > ends[0]) & (places[:, 0] < ends[1] + spacing)
        for place in places[near]:
            apart = np.hypot(*(self._spots - place).T) if len(self._spots) else np.zeros(0)
            same = int(np.argmin(apart)) if len(apart) else -1
            if same >= 0 and apart[same] < self._layout.label_radius:
                self._counts[same] += 1
                self._spots[same] += (place - self._spots[same]) / self._counts[same]
            else:
                self._spots = np.vstack([self._spots, place])
                self._counts = np.append(self._counts, 1.0)
        self.found = len(self._spots)
        self._settle()

    def _settle(self) -> None:
        """Number the dots by their distances, where these are about multiples of the spacing."""
        rotors, spacing = len(self.places), self._layout.chain.spacing
        often = np.argsort(-self._counts, kind='stable')[:rotors]
        order: NDArray[np.intp] = often[np.argsort(self._spots[often, 0])]
        if len(order) < _LEAST_SHARE * rotors:
            return
        xs = self._spots[order, 0]
        steps = np.diff(xs) / spacing
        numbers = np.cumsum(np.rint([xs[0] / spacing, *steps])).astype(np.intp)
        off = np.abs(steps - np.rint(steps)).max(initial=0.0)
        doubled = len(set(numbers.tolist())) < len(numbers)
        if off > _OFF or doubled or numbers[0] < 0 or numbers[-1] >= rotors:
            return
        self.known[numbers] = True
        counts = np.zeros(rotors)
        counts[numbers] = self._counts[order]
        self._counts = counts
        told = self.places[:, 0].copy()
        ahead = np.interp(told, told[numbers], xs - told[numbers])
        self.places = np.column_stack(
            [told + ahead, np.interp(told, told[numbers], self._spots[order, 1])]
        )
        self.places[numbers] = self._spots[order]
