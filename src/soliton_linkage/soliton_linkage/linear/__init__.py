# SPDX-License-Identifier: Apache-2.0
"""Linear theory about one configuration of a chain.

`rigidity` has the rigidity matrix, its zero modes and the mode at an edge, `bands` the phonons of
the uniform chain, `normal_modes` the phonons of any configuration, `statics` the equilibria.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
