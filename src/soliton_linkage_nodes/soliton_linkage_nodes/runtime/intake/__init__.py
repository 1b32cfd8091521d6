# SPDX-License-Identifier: Apache-2.0
"""What comes in to a node: whose it is, what of it was lost, and what it cannot stand."""
