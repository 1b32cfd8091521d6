# SPDX-License-Identifier: Apache-2.0
"""A chain that nobody has measured, from one recording in which a soliton has passed."""
