# SPDX-License-Identifier: Apache-2.0
"""Report of an analyser: status, figures, and contradictions to the parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import TrackingStatus
from soliton_linkage.linear.bands import gap
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis

_MISFIT_OVER_NOISE = 3.0
"""Largest misfit without a warning, relative to the noise of the angles [1]."""
_CONTRADICTION_CONFIDENCE = 0.999
"""Confidence in another class of motion above which the node warns [1]."""


def describe(analysis: JointStateAnalysis, misfit_limit: float) -> tuple[str, bool]:
    """Return a description of the status of the analysis, and whether it is a warning.

    A misfit of the angles above `misfit_limit` [rad] is a warning.
    """
    analyser, latest = analysis.analyser, analysis.latest
    if analyser is None or latest is None:
        return 'no frame yet', False
    disagreement = _disagreement(latest)
    if disagreement:
        return disagreement, True
    if latest.unseen:
        return f'{latest.unseen} of {len(analysis.joint_names)} rotors are not visible', True
    alone = len(latest.solitons) < 2 and not analyser.limitation
    if alone and latest.estimate.status is TrackingStatus.LOST:
        return (
            'the angles do not fit one wall of the chain; if the chain has one wall, check the '
            'parameters in chain and that joint_states are in rad',
            True,
        )
    misfit = latest.estimate.misfit
    explained = max(misfit_limit, _MISFIT_OVER_NOISE * latest.estimate.noise, _swing(analysis))
    if misfit > explained:
        return (
            f'the misfit of the angles is {misfit:.3g} rad, above the misfit_limit of '
            f'{misfit_limit:g} rad; check the parameters in chain and its publisher',
            True,
        )
    solitons = f'{len(latest.solitons)} solitons, {latest.status.value}'
    if analyser.limitation:
        return f'{solitons}; {analyser.limitation}', True
    return solitons, False


def _disagreement(latest: Analysis) -> str:
    """Return a warning if angles and parameters give different classes of motion, else ''."""
    specified, measured = latest.motion, latest.measured_motion
    certain = measured.confidence > _CONTRADICTION_CONFIDENCE
    shown = measured.motion
    if specified is None or shown is None or shown is specified or not certain:
        return ''
    return (
        f'the angles show a {shown.value} (confidence {measured.confidence:.4f}), the '
        f'parameters specify a {specified.value}; check chain.rotor_length, chain.spacing and '
        'chain.rest_angle'
    )


def _swing(analysis: JointStateAnalysis) -> float:
    """Return the largest RMS angle of phonons [rad] that is consistent with the rates.

    It is w / omega_0 with the RMS rate w, because phonons have at least the frequency omega_0 of
    the band gap.
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
    """Return the figures of the analysis for /diagnostics."""
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
