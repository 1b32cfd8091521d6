# SPDX-License-Identifier: Apache-2.0
"""A soliton carried to a place and held there, by feedback along the zero mode."""
