# SPDX-License-Identifier: Apache-2.0
"""Tabs of the page with controls."""
