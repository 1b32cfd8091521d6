# SPDX-License-Identifier: Apache-2.0
"""What frames of noisy angles show: where the chain is on its orbit, and all that follows."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
