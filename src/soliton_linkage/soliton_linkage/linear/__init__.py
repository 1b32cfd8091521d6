# SPDX-License-Identifier: Apache-2.0
"""Linear theory about one configuration of a chain.

`rigidity` has the rigidity matrix, its zero modes and the mode at an edge, `bands` the phonons of
the uniform chain, `normal_modes` those of any configuration, `statics` those at rest.
"""
