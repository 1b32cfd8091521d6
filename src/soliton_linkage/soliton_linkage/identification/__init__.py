# SPDX-License-Identifier: Apache-2.0
"""Identification of a chain from recordings of a passing soliton."""
