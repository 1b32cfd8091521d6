# SPDX-License-Identifier: Apache-2.0
"""Compare the speed of a soliton after a kick with the continuum theory."""

import numpy as np

import soliton_linkage as sl
from soliton_linkage.solitons.continuum import wall_theory

CHAIN = sl.Chain(number_of_rotors=30, rest_angle=0.3)
KICKS = (2.0, 4.0, 8.0, 12.0)
"""Kicks along the zero mode: norms of the angular velocities [rad/s]."""


def crossing_speed(chain: sl.Chain, kick: float) -> float:
    """Return the speed of the first crossing after a kick [m/s]; NaN if there is no crossing."""
    start = sl.leaning(chain, -1)
    rates = kick * sl.edge_mode(chain, start.angles, sl.Edge.FIRST)
    slow_rate = kick / sl.site_arc(chain)
    duration = 2 * chain.number_of_rotors / slow_rate
    recording = sl.simulate(chain, start.angles, rates, duration, period=duration / 200)
    crossings = sl.find_crossings(chain, sl.follow(chain, recording))
    return crossings[0].site_rate * chain.spacing if crossings else np.nan


def main(kicks: tuple[float, ...] = KICKS) -> dict[float, float]:
    """Print a table of relative speeds v / c, and return the speeds [m/s] by kick."""
    theory, sound = wall_theory(CHAIN), sl.speed_of_sound(CHAIN)
    speeds = {kick: crossing_speed(CHAIN, kick) for kick in kicks}
    print('kick [rad/s]   speed / c   theory / c')
    for kick, speed in speeds.items():
        expected = theory.speed_after_kick(CHAIN.rotor_length * kick)
        print(f'{kick:12g} {speed / sound:11.3f} {expected / sound:12.3f}')
    return speeds


if __name__ == '__main__':
    main()
