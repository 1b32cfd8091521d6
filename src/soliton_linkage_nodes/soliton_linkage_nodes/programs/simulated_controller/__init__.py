# SPDX-License-Identifier: Apache-2.0
"""A microcontroller with a simulated chain, on a pseudo-terminal."""
