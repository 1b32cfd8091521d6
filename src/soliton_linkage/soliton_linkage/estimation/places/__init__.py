# SPDX-License-Identifier: Apache-2.0
"""Places of a wall on the orbit of its chain: how likely a frame makes each, and which compete.

What a frame has beside a place is here as well, noise and offsets of encoders, and what moves a
wall on from frame to frame, pushes and springs that yield.
"""
