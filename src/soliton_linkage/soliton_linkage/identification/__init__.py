# SPDX-License-Identifier: Apache-2.0
"""Identification of a chain from one recording of a passing soliton."""
