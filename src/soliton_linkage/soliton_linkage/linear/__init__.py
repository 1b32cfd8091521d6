# SPDX-License-Identifier: Apache-2.0
"""Linear theory of small motions about a configuration of a chain.

`rigidity` computes the rigidity matrix, the zero modes and the mode at an edge. `bands` computes
the phonons of the uniform chain, and `normal_modes` the modes about any relaxed configuration.
`statics` computes configurations at rest.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
