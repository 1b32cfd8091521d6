# SPDX-License-Identifier: Apache-2.0
"""The zero-energy orbit: the closed curve along which the wall of a chain runs to and fro."""
