# SPDX-License-Identifier: Apache-2.0
"""Physics and analysis of a topological rotor linkage, as functions of arrays.

In this example a kick at the first edge sends a soliton through the chain and back:

>>> import soliton_linkage as sl
>>> chain = sl.Chain(number_of_rotors=20)
>>> start = sl.leaning(chain, -1)
>>> rates = 10 * sl.edge_mode(chain, start.angles, sl.Edge.FIRST)
>>> recording = sl.simulate(chain, start.angles, rates, duration=5, period=0.02)
>>> track = sl.follow(chain, recording)
>>> [crossing.direction for crossing in sl.find_crossings(chain, track)]
[1, -1]

Each folder imports only from earlier folders in this list: `linkage`, `linear`, `solitons`,
`orbit`, `dynamics`, `actuation`, `estimation`, `identification`, `steering`, `vision` and
`microcontroller`. A *wall* is a domain wall: rotors on opposite sides of it lean in opposite
directions. A *soliton* is a moving wall; in names of classes and topics, it is any wall, also at
rest. *Bond* n consists of the neighbouring rotors n and n + 1, spring n, which joins them, and the
line between their pivots. A *bar* is a spring that keeps its rest length. The *orbit* is the
closed curve of all zero-energy configurations. In one *cycle* the chain moves once along the whole
orbit. The word *flipper* includes wobbling flippers, except where d <= 1 is stated and in the
values of `Motion`.

Angles are the angles phi [rad] unless a name contains `staggered`. The last axis of an array is
the index of the rotor. Docstrings of tuned constants state sensitivities: 0.5x means half the
value of the constant, and 2x twice its value. The symbols of the equations are as follows; c, u
and v have two meanings each. If a docstring defines a symbol itself, its definition holds there:

========== ======================= ==========================================================
symbol     name                    meaning
========== ======================= ==========================================================
N          number_of_rotors        rotors n = 0 to N-1, joined by N-1 springs
a          spacing                 distance between neighbouring pivots [m]
r          rotor_length            distance from pivot to mass [m]
theta_bar  rest_angle              staggered angle of the right-leaning ground state [rad]
M          mass                    at the end of each rotor [kg]
k_e        stiffness               of each spring [N/m]
lbar       rest_length             of each spring [m]
phi        angles                  angle of each rotor from +z towards +x [rad]
theta      staggered angles        phi on rotors 0, 2, ..., pi - phi on the others [rad]
q          coordinate              of each rotor: phi in spinners, theta in flippers [rad]
h, v       horizontal, vertical    position of a mass from its pivot, r sin phi and r cos phi
c          offsets                 of each spring, a^2 + 2 r^2 - lbar^2 [m^2]
I          moments_of_inertia      of each rotor about its pivot, M r^2 [kg m^2]
d          lean_ratio              2 r sin(theta_bar) / a
d_c        critical_lean_ratio     2 / sin(theta_bar), beyond which rotors spin
ub         lean                    r sin(theta_bar) [m]
q+, q-     couplings               -dl_n/dtheta_n, -dl_n/dtheta_{n+1}, uniform state [m/rad]
ell        penetration_depth       decay length of the zero mode from its edge [m]
t          zero mode               unit vector with R t = 0
R          rigidity matrix         derivatives of the spring lengths by the angles [m/rad]
N_0, N_ss  zero modes, self-stress number of each; N_0 - N_ss = N - number of springs
omega, k   frequency, wave number  of a phonon [rad/s], [rad/m]; gap omega_0 at k_0
c          speed_of_sound          omega^2 = omega_0^2 + c^2 (k - k_0)^2 near the gap [m/s]
Lambda     site_arc                arc length of the orbit per rotor spacing [rad]
v          velocity                of a wall [m/s]
gamma      lorentz_factor          1 / sqrt(1 - v^2 / c^2)
E_s        energy_scale            half of the energy of an anti-kink at rest [J]
Q          charge                  +1: kink (leans right on rotor 0's side); -1: anti-kink
u          displacement            r sin(theta) [m]
m          order field             +1 where the chain leans right, -1 where it leans left
X, w       position, width         of a wall m = -Q tanh((x - X) / w) [m]
p, u       pressure, command       actual and commanded pressure of a soft actuator [Pa]
tau        filling, venting time   time constants with which p approaches u [s]
========== ======================= ==========================================================
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
