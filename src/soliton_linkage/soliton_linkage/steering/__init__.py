# SPDX-License-Identifier: Apache-2.0
"""Position control of a soliton by feedback along the zero mode.

In each frame, `Steering` estimates the motion of the wall with a `WallObserver`. It then computes
the force that keeps the wall on a `ReferenceTrajectory`, and converts this force into torques with
`TorqueAllocation`.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
