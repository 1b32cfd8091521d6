# SPDX-License-Identifier: Apache-2.0
"""Physics and analysis of a topological rotor linkage; arrays in, frozen dataclasses out.

A first script, in which a kick of the first edge sends a soliton through the chain and back:

>>> import soliton_linkage as sl
>>> chain = sl.Chain(number_of_rotors=20)
>>> start = sl.leaning(chain, -1)
>>> rates = 10 * sl.edge_mode(chain, start.angles, sl.Edge.FIRST)
>>> recording = sl.simulate(chain, start.angles, rates, duration=5, period=0.02)
>>> track = sl.follow(chain, recording)
>>> [crossing.direction for crossing in sl.find_crossings(chain, track)]
[1, -1]

Folders, each of which imports only from the folders above it:

============== ==============================================================================
linkage        the chain: parameters, deviations, gravity, encoders, recorded motion
linear         linear theory about a configuration: rigidity, zero mode, bands, statics
solitons       walls at rest, in the continuum, in the unit cell; found and tracked in frames
orbit          the zero-energy orbit, the closed curve along which a wall moves
dynamics       simulations of springs and of rigid bars, integrators, energy balance
actuation      soft actuators, commands, and their torques and impulses
estimation     the analyser: positions of walls from noisy angles
identification parameters of a chain from recorded angles
steering       controlled motion of a soliton
============== ==============================================================================

A *wall*, short for domain wall, is where the chain changes from leaning right to leaning left; a
*soliton* is a wall that moves, as topics and messages call it. The *orbit* is the curve of all
zero-energy configurations; a *cycle* is one round of it.

Angles are plain angles phi [rad], with the rotors on the last axis, unless a name contains
`staggered`. The symbols of the equations:

========== ======================= ==========================================================
symbol     name                    meaning
========== ======================= ==========================================================
N          number_of_rotors        rotors n = 0 ... N-1, joined by N-1 springs
a          spacing                 between neighbouring pivots [m]
r          rotor_length            from pivot to mass [m]
theta_bar  rest_angle              staggered angle of the right-leaning ground state [rad]
M          mass                    at the end of each rotor [kg]
k_e        stiffness               of each spring [N/m]
lbar       rest_length             of each spring [m]
phi        angles                  of the rotors from +z towards +x [rad]
theta      staggered angles        phi on rotors 0, 2, ..., pi - phi on the others [rad]
h, v       horizontal, vertical    position of a mass from its pivot, r sin phi and r cos phi
I          moments_of_inertia      of each rotor about its pivot, M r^2 [kg m^2]
d          lean_ratio              2 r sin(theta_bar) / a
d_c        critical_lean_ratio     2 / sin(theta_bar), beyond which rotors spin
ub         lean                    r sin(theta_bar) [m]
q+, q-     couplings               change of a spring's length with the angles it joins
ell        penetration_depth       of the zero mode from its edge [m]
t          zero mode               unit vector with R t = 0
R          rigidity matrix         change of the springs' lengths with the angles [m/rad]
N_0, N_ss  zero modes, self-stress of a configuration: N_0 - N_ss = N - springs
omega, k   frequency, wave number  of a phonon [rad/s], [rad/m]; gap omega_0
c          speed_of_sound          of omega^2 = omega_0^2 + c^2 k^2 about the gap [m/s]
Lambda     site_arc                arc of the zero-energy orbit from rotor to rotor [rad]
gamma      lorentz_factor          1 / sqrt(1 - v^2 / c^2) of a wall of velocity v
E_s        energy_scale            half of what an anti-kink costs at rest [J]
Q          charge                  +1: right-leaning before the wall, free at rest; -1: anti-kink
u          displacement            r sin(theta) [m]
m          order field             +1 where the chain leans right, -1 where it leans left
X, w       position, width         of a wall m = -tanh((x - X) / w) [m]
p, u       pressure, command       in the chamber of a soft actuator, and asked for [Pa]
tau        filling, venting time   with which p tends to u [s]
========== ======================= ==========================================================
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
