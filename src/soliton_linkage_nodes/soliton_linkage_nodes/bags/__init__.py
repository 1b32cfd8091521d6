# SPDX-License-Identifier: Apache-2.0
"""Recording, playback, reading and recovery of bags. A bag may contain any topics."""
