# SPDX-License-Identifier: Apache-2.0
"""Chains in motion: simulations of springs and of rigid bars, and their energy balance."""
