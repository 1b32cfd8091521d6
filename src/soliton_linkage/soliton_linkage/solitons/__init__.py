# SPDX-License-Identifier: Apache-2.0
"""Domain walls as they are: at rest, in the continuum, in the unit cell, fitted and tracked."""
