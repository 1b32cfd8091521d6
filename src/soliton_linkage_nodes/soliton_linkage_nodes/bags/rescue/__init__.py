# SPDX-License-Identifier: Apache-2.0
"""Bags that were damaged or never finished: what is intact in them comes back."""
