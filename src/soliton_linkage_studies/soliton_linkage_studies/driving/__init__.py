# SPDX-License-Identifier: Apache-2.0
"""Chains driven in every way there is, on one page: whether what was promised holds."""
