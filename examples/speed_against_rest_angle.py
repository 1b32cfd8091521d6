# SPDX-License-Identifier: Apache-2.0
"""Compare the speed of a soliton after one kick in chains with different rest angles.

A slow wall of the discrete chain has the speed v = a |phi_dot| / Lambda with the arc length Lambda
of the zero-energy orbit per rotor spacing.
"""

import numpy as np

import soliton_linkage as sl

REST_ANGLES = (0.3, 0.5, 0.7, 0.97)
"""Rest angles of the uniform right-leaning state [rad]."""
KICK = 2.0
"""Kick along the zero mode: norm of the angular velocities [rad/s]."""


def crossing_speed(chain: sl.Chain, kick: float) -> float:
    """Return the speed of the first crossing after a kick [m/s]; NaN if there is no crossing."""
    start = sl.leaning(chain, -1)
    rates = kick * sl.edge_mode(chain, start.angles, sl.Edge.FIRST)
    duration = 2 * chain.number_of_rotors * sl.site_arc(chain) / kick
    recording = sl.simulate(chain, start.angles, rates, duration, period=duration / 200)
    crossings = sl.find_crossings(chain, sl.follow(chain, recording))
    return crossings[0].site_rate * chain.spacing if crossings else np.nan


def main(rest_angles: tuple[float, ...] = REST_ANGLES) -> dict[float, tuple[float, float]]:
    """Print and return, for each rest angle, the measured and the slow-wall speed [m/s]."""
    speeds = {}
    print('rest angle [rad]   speed [m/s]   a |phi_dot| / Lambda [m/s]')
    for rest_angle in rest_angles:
        chain = sl.Chain(number_of_rotors=30, rest_angle=rest_angle)
        slow = chain.spacing * KICK / sl.site_arc(chain)
        speeds[rest_angle] = crossing_speed(chain, KICK), slow
        print(f'{rest_angle:16g} {speeds[rest_angle][0]:13.4f} {slow:28.4f}')
    return speeds


if __name__ == '__main__':
    main()
