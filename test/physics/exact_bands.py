# SPDX-License-Identifier: Apache-2.0
"""The couplings and frequencies of a chain to any number of digits, and chains at every limit."""

import dataclasses
import math
from dataclasses import dataclass

from chains import any_chain
from hypothesis import strategies as st
from mpmath import mp, mpf

from soliton_linkage.linkage.chain import Chain


@dataclass(frozen=True)
class Exact:
    """A chain's couplings [m/rad] and r sqrt(M / k_e) [m s], to forty digits."""

    plus: mpf
    minus: mpf
    unit: mpf

    def squared_frequency(self, phase: mpf, branch: int) -> mpf:
        return abs(self.plus + branch * self.minus * mp.expj(phase)) ** 2 / self.unit**2


def exact(chain: Chain) -> Exact:
    """Evaluate the definitions in as many digits as `mp` has now."""
    a, r = mpf(chain.spacing), mpf(chain.rotor_length)
    sine, cosine = mp.sin(mpf(chain.rest_angle)), mp.cos(mpf(chain.rest_angle))
    scale = r * cosine / mp.sqrt(a**2 + 4 * r**2 * cosine**2)
    unit = r * mp.sqrt(mpf(chain.mass) / mpf(chain.stiffness))
    return Exact(scale * (2 * r * sine + a), scale * (2 * r * sine - a), unit)


@st.composite
def extreme_chain(draw: st.DrawFn) -> Chain:
    """Draw a chain of any rest angle that a chain may have and r / a from 1e-6 to 1e6."""
    chain = draw(any_chain())
    ratio = 10 ** draw(st.floats(-6, 6))
    longer = 10 ** draw(st.floats(0.1, 2.9))
    spacing, rotor_length = (longer, longer * ratio) if ratio < 1 else (longer / ratio, longer)
    rest_angle = draw(st.one_of(st.floats(1e-3, 1.57), st.sampled_from([1e-3, 1.57])))
    return dataclasses.replace(
        chain, spacing=spacing, rotor_length=rotor_length, rest_angle=rest_angle
    )


def nearly_one(tilt: float) -> Chain:
    """Return a chain with a lean ratio of 1 + tilt, to rounding."""
    return Chain(2, spacing=0.1, rotor_length=0.1 * (1 + tilt), rest_angle=math.asin(0.5))


ANY_LEAN_RATIO = st.one_of(
    any_chain(),
    extreme_chain(),
    st.builds(nearly_one, st.floats(-15, -1).map(lambda power: 10**power)),
    st.builds(nearly_one, st.floats(-15, -1).map(lambda power: -(10**power))),
)
