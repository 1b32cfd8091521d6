# SPDX-License-Identifier: Apache-2.0
"""The chain itself: its parameters and deviations, gravity, encoders, and recorded motion."""
