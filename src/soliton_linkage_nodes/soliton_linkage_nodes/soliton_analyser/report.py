# SPDX-License-Identifier: Apache-2.0
"""What an analyser says about itself: what it sees, and where that is not what it was told."""

from __future__ import annotations

from typing import Any

import numpy as np

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import TrackingStatus
from soliton_linkage.linear.bands import gap
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis

_OF_NOISE = 3.0
"""How many times the noise of the angles their misfit may be, however large that is [1]."""
_SURE_TO_DISAGREE = 0.999
"""Confidence in another class of motion above which the parameters are called wrong [1]."""


def describe(analysis: JointStateAnalysis, misfit_limit: float) -> tuple[str, bool]:
    """How the analysis is doing, in a sentence, and whether that is a warning.

    It is one where angles miss the chain's configurations by more than a limit [rad].
    """
    analyser, latest = analysis.analyser, analysis.latest
    if analyser is None or latest is None:
        return 'no frame yet', False
    disagreement = _disagreement(latest)
    if disagreement:
        return disagreement, True
    if latest.unseen:
        return f'{latest.unseen} of {len(analysis.joint_names)} rotors are not seen', True
    alone = len(latest.solitons) < 2 and not analyser.limitation
    if alone and latest.estimate.status is TrackingStatus.LOST:
        return (
            'the angles are not those of one wall of the chain; unless several run or it broke '
            'up, check that joint_states are in rad, and the parameters in chain',
            True,
        )
    misfit = latest.estimate.misfit
    explained = max(misfit_limit, _OF_NOISE * latest.estimate.noise, _swing(analysis))
    if misfit > explained:
        return (
            f'the angles miss the configurations of the chain by {misfit:.3g} rad, more than the '
            f'misfit_limit of {misfit_limit:g} rad; check who publishes chain, and its parameters',
            True,
        )
    solitons = f'{len(latest.solitons)} solitons, {latest.status.value}'
    if analyser.limitation:
        return f'{solitons}; {analyser.limitation}', True
    return solitons, False


def _disagreement(latest: Analysis) -> str:
    """Say so where the angles speak for another class of motion than the parameters."""
    told, shown = latest.motion, latest.measured_motion
    sure = shown.confidence > _SURE_TO_DISAGREE
    if told is None or shown.motion is None or shown.motion is told or not sure:
        return ''
    return (
        f'the angles are those of a {shown.motion.value} (confidence {shown.confidence:.4f}), '
        f'the parameters those of a {told.value}; check chain.rotor_length, chain.spacing and '
        'chain.rest_angle'
    )


def _swing(analysis: JointStateAnalysis) -> float:
    """Root mean square that vibrations of the rotors' rates may have, at most [rad]: w / omega_0.

    None vibrates more slowly than with omega_0, the gap of the phonons.
    """
    frame, analyser = analysis.frame, analysis.analyser
    if frame is None or frame.rates is None or not isinstance(analyser, Analyser):
        return 0.0
    rates = frame.rates[np.isfinite(frame.rates)]
    slowest = gap(analyser.chain)
    if not (len(rates) and slowest):
        return 0.0
    return float(np.sqrt(np.mean(rates**2))) / slowest


def figures(analysis: JointStateAnalysis) -> dict[str, Any]:
    """Figures of the analysis."""
    analyser, latest = analysis.analyser, analysis.latest
    if analyser is None or latest is None:
        return {}
    return {
        'late frames': analyser.late,
        'late impulses': analyser.late_impulses,
        'solitons': len(latest.solitons),
        'status': latest.status.value,
        'unseen rotors': latest.unseen,
        'noise [rad]': latest.estimate.noise,
        'misfit [rad]': latest.estimate.misfit,
        'starts': analyser.starts,
        'motion of the angles': getattr(latest.measured_motion.motion, 'value', 'unknown'),
        'confidence': latest.measured_motion.confidence,
        'encoder offsets [rad]': ', '.join(
            f'{analysis.joint_names[rotor]} {analyser.offsets[rotor]:.4f} +- '
            f'{analyser.offset_deviations[rotor]:.4f}'
            for rotor in np.flatnonzero(analyser.offsets)
        ),
    }
