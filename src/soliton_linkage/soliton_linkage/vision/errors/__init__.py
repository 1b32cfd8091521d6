# SPDX-License-Identifier: Apache-2.0
"""By how much seen places are off beyond the noise of pixels: scatter, repeats, a dead zone."""
