# SPDX-License-Identifier: Apache-2.0
"""The continuum theory of a chain, whichever it is."""

from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.solitons.continuum import FlipperTheory, SpinnerTheory

WIDEST_FLIPPER = (0.5, 0.1)
Theory = FlipperTheory | SpinnerTheory


def theory_of(chain: Chain, exact_sound: bool = True) -> Theory:
    if chain.motion is Motion.SPINNER:
        return SpinnerTheory(chain, exact_sound)
    return FlipperTheory(chain, exact_sound)
