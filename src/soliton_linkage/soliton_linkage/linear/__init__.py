# SPDX-License-Identifier: Apache-2.0
"""Linear theory: rigidity and zero modes, phonon bands, normal modes, configurations at rest."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
