# SPDX-License-Identifier: Apache-2.0
"""The zero-energy orbit: the closed curve along which the wall of a chain runs to and fro.

Once round it is a cycle. `orbit_of` makes that of any chain, an `Orbit`: `UniformOrbit` without
deviations, from the orbit of a short chain, and `DeviatingOrbit` with them, from pieces.
"""

from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit, orbit_of
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

__all__ = ['DeviatingOrbit', 'Orbit', 'OrbitSegment', 'UniformOrbit', 'orbit_of']
