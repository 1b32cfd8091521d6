# SPDX-License-Identifier: Apache-2.0
"""Parts of the player: playback clock and thread, publishers, services and keys."""
