# SPDX-License-Identifier: Apache-2.0
"""Physics and analysis of a topological rotor linkage; arrays in, frozen dataclasses out.

Angles are the actual ones, phi [rad], with the rotors on the last axis, unless a name says
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
d          lean_ratio              2 r sin(theta_bar) / a
q+, q-     couplings               change of a spring's length with the angles it joins
ell        penetration_depth       of the zero mode from its edge [m]
t          zero mode               unit vector with R t = 0
R          rigidity matrix         change of the springs' lengths with the angles [m/rad]
m          order field             +1 where the chain leans right, -1 where it leans left
X, w       position, width         of a wall m = -tanh((x - X) / w) [m]
========== ======================= ==========================================================
"""
