# SPDX-License-Identifier: Apache-2.0
"""What the player is made of: its clock, its back-pressure and its keys."""
