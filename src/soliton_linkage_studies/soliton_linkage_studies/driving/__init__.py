# SPDX-License-Identifier: Apache-2.0
"""Study of chains that are driven by an actuator, a tilt or a controller."""
