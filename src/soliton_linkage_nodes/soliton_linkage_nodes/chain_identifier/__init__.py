# SPDX-License-Identifier: Apache-2.0
"""Node that estimates each rotor length, pivot distance and spring rest length of a chain."""
