# SPDX-License-Identifier: Apache-2.0
"""Components of the player: clock, thread, publishers, services and keys."""
