# SPDX-License-Identifier: Apache-2.0
"""Domain walls (*walls*): angles at rest, continuum theories, and detection of moving walls."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
