# SPDX-License-Identifier: Apache-2.0
"""Places of a wall on the orbit of its chain: how likely a frame makes each, and which compete."""
