# SPDX-License-Identifier: Apache-2.0
"""Zero-energy orbit: the closed curve of configurations along which the wall of a chain moves.

During one cycle of the wall, the chain runs once along the curve. `orbit_of` returns an `Orbit`
for any chain: a `UniformOrbit` without deviations, and a `DeviatingOrbit` with them.
"""

from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit, orbit_of
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

__all__ = ['DeviatingOrbit', 'Orbit', 'OrbitSegment', 'UniformOrbit', 'orbit_of']
