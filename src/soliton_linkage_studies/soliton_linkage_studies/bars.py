# SPDX-License-Identifier: Apache-2.0
"""How fast springs that get stiffer come to move as rigid bars."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from soliton_linkage_studies.palette import MEASURED, THEORY


def convergence_order(stiffnesses: ArrayLike, distances: ArrayLike) -> float:
    """Order in 1 / k_e of distances from rigid bars, by the three stiffest springs [1]."""
    stiffest, nearest = np.log(np.asarray(stiffnesses)[-3:]), np.log(np.asarray(distances)[-3:])
    return -float(np.polyfit(stiffest, nearest, 1)[0])


def draw_convergence(axes: Axes, stiffnesses: ArrayLike, distances: ArrayLike, label: str) -> Axes:
    """Draw distances of an angle from rigid bars [rad], both (K,), and a line of order 1."""
    across, up = np.asarray(stiffnesses), np.asarray(distances)
    axes.loglog(across, up, 'o', color=MEASURED, label=label)
    axes.loglog(
        across, up[-1] * across[-1] / across, '--', color=THEORY, label=r'order 1, $\propto 1/k_e$'
    )
    axes.set(ylabel='largest distance of an angle [rad]')
    axes.legend()
    return axes
