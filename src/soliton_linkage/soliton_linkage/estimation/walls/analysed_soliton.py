# SPDX-License-Identifier: Apache-2.0
"""What an analysis tells of a wall."""

from __future__ import annotations

from typing import NamedTuple


class AnalysedSoliton(NamedTuple):
    """One wall; a quantity that cannot be told is NaN, and so is its standard deviation.

    id: its name for as long as it is followed, from 1 on; 0 where walls are not followed.
    rotor: centre in rotor spacings from rotor 0.
    position: centre [m] from the pivot of rotor 0.
    velocity: of the centre [m/s], positive towards the last rotor.
    width: width w of tanh(x / w) [m]; NaN in chains with deviations.
    theory_width: width that the continuum theory gives a wall of this velocity [m].
    charge: +1: leans right on the side of rotor 0 and left beyond, free at rest; -1: the opposite.
    position_deviation: standard deviation of the position [m].
    velocity_deviation: standard deviation of the velocity [m/s].
    width_deviation: standard deviation of the width [m].
    """

    id: int
    rotor: float
    position: float
    velocity: float
    width: float
    theory_width: float
    charge: int
    position_deviation: float
    velocity_deviation: float
    width_deviation: float
