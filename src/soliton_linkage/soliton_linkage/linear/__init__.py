# SPDX-License-Identifier: Apache-2.0
"""Linear theory of small motions about one configuration of a chain.

`rigidity` computes the rigidity matrix, the zero modes and the mode at an edge. `bands` computes
the phonons of the uniform chain, `normal_modes` those of any configuration. `statics` computes
equilibria.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
