# SPDX-License-Identifier: Apache-2.0
"""Status of the chains and of their nodes for the page."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Mapping
from typing import Any

from soliton_linkage_nodes.live_view.chain_topics import REPORT_TIMEOUT, ChainFinder, ChainTopics
from soliton_linkage_nodes.live_view.commands import READ_ONLY, ChainCommands
from soliton_linkage_nodes.messages.view_conversions import NodeReport, figure

REPLAY = '/replay/'
_DROP_AGE = 30.0
"""Age above which a report is ignored [s]."""
_LONGEST_DELAY = 0.2
"""The page warns if the delay of soliton_state behind joint_states exceeds both this time [s] and
two frames (`_FRAMES_BEHIND`)."""
_ENDING = ('bag_player', 'bag_recorder')
"""Nodes that end in normal operation. The page does not warn if their reports are missing."""
_FRAMES_BEHIND = 2
"""Number of frames by which soliton_state may be behind joint_states without a warning [1]. The
number exceeds 1, because one frame is always in transit."""
_LATE = re.compile('deadlines missed in the last second')
"""Pattern of the warning about missed deadlines. The page omits this warning, because it shows the
fraction of late frames instead."""
_PAUSED = re.compile(f'{_LATE.pattern}|^waiting for joint_states')
"""Pattern of the warnings that the page omits while a simulation is paused."""
_SIMULATOR = 'only a simulator can do this; no simulator of this chain is running'
_NEEDS = {
    'nudge': ('nudge', 'no node subscribes to nudge; start edge_actuator'),
    'drive': ('edge_command', 'no node subscribes to edge_command; start edge_actuator'),
    'tilt': ('tilt', f'no node subscribes to tilt; {_SIMULATOR}'),
    'pause': ('simulator/pause', _SIMULATOR),
    'step': ('simulator/step', _SIMULATOR),
    'reset': ('simulator/reset', _SIMULATOR),
    'move': ('move_soliton', 'no node serves move_soliton; start soliton_steering'),
    'identify': ('chain_identifier/identify', 'no node serves identify; start chain_identifier'),
}
"""Topic, service or action that each control needs, and the text that the page shows if it is
missing."""
CONTROLS = tuple(_NEEDS)


def _reasons(chain: ChainTopics, commands: ChainCommands) -> dict[str, str]:
    if commands.read_only:
        return dict.fromkeys(CONTROLS, READ_ONLY)
    if chain.namespace.startswith(REPLAY):
        return dict.fromkeys(CONTROLS, 'this chain is a replay of a bag')
    return {
        control: '' if commands.reaches(name) else reason
        for control, (name, reason) in _NEEDS.items()
    }


def reports_of(finder: ChainFinder, namespace: str) -> list[tuple[float, NodeReport]]:
    """Return the last report of each node in a namespace, and the age of each report [s]."""
    now = time.monotonic()
    return [
        (now - received_at, report)
        for received_at, report in finder.reports.values()
        if f'/{report.node.lstrip("/")}'.rpartition('/')[0] + '/' == namespace
        and now - received_at < _DROP_AGE
    ]


def _health(finder: ChainFinder, chain: ChainTopics) -> dict[str, Any]:
    figures: Mapping[str, str] = {}
    lost: int | None = None
    warnings, paused, replay = [], False, ''
    reports = reports_of(finder, chain.namespace)
    for age, report in reports:
        if 'missed deadlines' in report.figures:
            figures = report.figures
            paused = report.message.startswith('paused') and age < REPORT_TIMEOUT
    expected = _PAUSED if paused else _LATE
    for age, report in reports:
        name = report.node.rpartition('/')[2]
        if name == 'bag_player' and age < REPORT_TIMEOUT:
            replay = report.figures.get('bag', '').rpartition('/')[2]
        losses = figure(report.figures, 'lost messages')
        lost = lost if math.isnan(losses) else (lost or 0) + int(losses)
        if age > REPORT_TIMEOUT and name not in _ENDING:
            warnings.append(f'{name} has not reported for {age:.0f} s')
        elif age <= REPORT_TIMEOUT and report.level and not expected.search(report.message):
            warnings.append(f'{name}: {report.message}')
    if chain.publishers > 1:
        warnings.append(f'{chain.publishers} nodes publish joint_states; stop all but one')
    delay, rate = chain.model.delay, chain.model.rate
    if delay > _LONGEST_DELAY and delay * rate > _FRAMES_BEHIND:
        warnings.append(f'soliton_state is {delay:.1f} s behind joint_states')
    return {
        'rate': None if math.isnan(rate) else round(rate),
        'factor': figures.get('real-time factor', ''),
        'late': finder.late_share(chain.namespace),
        'lost': lost,
        'paused': paused,
        'replay': replay,
        'conflict': chain.conflict,
        'warnings': warnings,
        'error': chain.model.error,
    }


def gravity_of(finder: ChainFinder, namespace: str) -> tuple[float, float]:
    """Return the gravity [m/s^2] and the tilt [rad] that the simulator reports.

    Without a report, both are NaN.
    """
    for _, report in reports_of(finder, namespace):
        if 'gravity [m/s^2]' in report.figures:
            figures = report.figures
            return figure(figures, 'gravity [m/s^2]'), figure(figures, 'tilt [rad]')
    return math.nan, math.nan


def status_of(finder: ChainFinder, chain: ChainTopics, commands: ChainCommands) -> dict[str, Any]:
    """Return the status of a chain for the page, as JSON values."""
    move = commands.move
    return {
        'name': chain.namespace,
        'replay': chain.namespace.startswith(REPLAY),
        'health': _health(finder, chain),
        'reasons': _reasons(chain, commands),
        'camera': chain.camera.reason,
        'move': {
            'state': move.state,
            'foreign': move.foreign,
            'message': move.message,
            'goal': move.goal if math.isfinite(move.goal) else None,
            'progress': round(move.progress, 3),
        },
    }
