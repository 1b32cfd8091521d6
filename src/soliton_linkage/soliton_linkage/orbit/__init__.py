# SPDX-License-Identifier: Apache-2.0
"""Zero-energy orbit: the closed curve of the configurations of a chain while its wall moves."""

from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit, orbit_of
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

__all__ = ['DeviatingOrbit', 'Orbit', 'OrbitSegment', 'UniformOrbit', 'orbit_of']
