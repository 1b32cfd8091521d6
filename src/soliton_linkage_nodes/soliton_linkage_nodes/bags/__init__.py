# SPDX-License-Identifier: Apache-2.0
"""Recording, playback, reading and recovery of bags, with any topics."""
