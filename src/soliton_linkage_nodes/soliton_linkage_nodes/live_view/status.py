# SPDX-License-Identifier: Apache-2.0
"""The status of chains and nodes on the page."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from typing import Any

from soliton_linkage_nodes.live_view.chain_topics import REPORTS_LAST, ChainFinder, ChainTopics
from soliton_linkage_nodes.live_view.commands import READ_ONLY, ChainCommands
from soliton_linkage_nodes.messages.view_conversions import NodeReport, figure

_FORGOTTEN = 30.0
"""Age after which the report of a silent node is dropped [s]."""
_LONGEST_LAG = 0.2
"""Largest delay of soliton_state behind joint_states [s]; a larger one is visible."""
_FRAMES_BEHIND = 2
"""Largest delay in frames [1]; the state of one frame is in transit."""
_ACTUATOR = 'start edge_actuator'
_SIMULATOR = 'only a simulator does that, and none runs here'
_REPLAY = 'this is a replay'


def reasons(chain: ChainTopics, commands: ChainCommands) -> dict[str, str]:
    """Return the reason why each control of a chain is inactive, empty if it is active."""
    if commands.read_only:
        return dict.fromkeys(CONTROLS, READ_ONLY)
    if chain.namespace.startswith(REPLAY):
        return dict.fromkeys(CONTROLS, _REPLAY)

    def served(name: str, otherwise: str) -> str:
        return '' if commands.serves(name) else otherwise

    def heard(topic: str, otherwise: str) -> str:
        return '' if commands.listeners(topic) else f'nothing subscribes to {topic}: {otherwise}'

    return {
        'nudge': heard('nudge', _ACTUATOR),
        'drive': heard('edge_command', _ACTUATOR),
        'tilt': heard('tilt', _SIMULATOR),
        'pause': served('simulator/pause', _SIMULATOR),
        'step': served('simulator/step', _SIMULATOR),
        'reset': served('simulator/reset', _SIMULATOR),
        'move': served('move_soliton', 'nothing serves move_soliton: start soliton_steering'),
        'release': served(
            'soliton_steering/release', 'nothing serves release: start soliton_steering'
        ),
        'identify': served(
            'chain_identifier/identify', 'nothing serves identify: start chain_identifier'
        ),
    }


REPLAY = '/replay/'
"""Namespace in which a bag is played, beside the chains that move."""
CONTROLS = ('nudge', 'drive', 'tilt', 'pause', 'step', 'reset', 'move', 'release', 'identify')
"""Names of controls."""


def reports_of(finder: ChainFinder, namespace: str) -> list[tuple[float, NodeReport]]:
    """Return the age [s] and the last report of each node of a namespace."""
    now = time.monotonic()
    return [
        (now - came, report)
        for came, report in finder.reports.values()
        if f'/{report.node.lstrip("/")}'.rpartition('/')[0] + '/' == namespace
        and now - came < _FORGOTTEN
    ]


def health(finder: ChainFinder, chain: ChainTopics) -> dict[str, Any]:
    """Return rate, deadlines, losses and warnings of a chain."""
    told = reports_of(finder, chain.namespace)
    figures: Mapping[str, str] = {}
    lost: int | None = None
    warnings, paused, replay = [], False, ''
    for age, report in told:
        name = report.node.rpartition('/')[2]
        if 'missed deadlines' in report.figures:
            figures = report.figures
            paused = report.message.startswith('paused') and age < REPORTS_LAST
        if name == 'bag_player' and age < REPORTS_LAST:
            replay = report.figures.get('bag', '').rpartition('/')[2]
        losses = figure(report.figures, 'lost messages')
        lost = lost if math.isnan(losses) else (lost or 0) + int(losses)
        if age > REPORTS_LAST:
            warnings.append(f'{name} has not reported for {age:.0f} s')
        elif report.level:
            warnings.append(f'{name}: {report.message}')
    if chain.publishers > 1:
        warnings.append(f'{chain.publishers} nodes publish joint_states of this chain at once')
    behind, rate = chain.model.behind, chain.model.rate
    if behind > _LONGEST_LAG and behind * rate > _FRAMES_BEHIND:
        warnings.append(f'soliton_state is {behind:.1f} s behind joint_states')
    return {
        'rate': None if math.isnan(rate) else round(rate),
        'factor': figures.get('real-time factor', ''),
        'missed': figures.get('missed deadlines', ''),
        'lost': lost,
        'paused': paused,
        'replay': replay,
        'warnings': warnings,
        'complaint': chain.model.complaint,
    }


def gravity_of(finder: ChainFinder, namespace: str) -> tuple[float, float]:
    """Return gravity [m/s^2] and tilt [rad] of a simulator, NaN without one."""
    for _, report in reports_of(finder, namespace):
        if 'gravity [m/s^2]' in report.figures:
            figures = report.figures
            return figure(figures, 'gravity [m/s^2]'), figure(figures, 'tilt [rad]')
    return math.nan, math.nan


def status(
    finder: ChainFinder,
    commands: Mapping[str, ChainCommands],
    why: Mapping[str, Mapping[str, str]],
    more: Mapping[str, Any],
) -> str:
    """Return the status of all chains as JSON; `why` has the `reasons` of each."""
    chains = []
    for namespace, chain in finder.chains.items():
        move = commands[namespace].move
        chains.append(
            {
                'name': namespace,
                'replay': namespace.startswith(REPLAY),
                'health': health(finder, chain),
                'reasons': why[namespace],
                'camera': chain.camera.reason,
                'move': {
                    'state': move.state,
                    'elsewhere': move.elsewhere,
                    'message': move.message,
                    'goal': _number(move.goal),
                    'progress': round(move.progress, 3),
                },
            }
        )
    return json.dumps({'status': {'chains': chains, **more}})


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
