# SPDX-License-Identifier: Apache-2.0
"""Guided experiments of the lesson."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from nicegui import ui

from soliton_linkage_nodes.live_view.commands import READ_ONLY
from soliton_linkage_nodes.live_view.controls.drive_controls import Shown, button
from soliton_linkage_nodes.live_view.lesson import EXPERIMENTS, GuidedExperiment, Laboratory
from soliton_linkage_nodes.live_view.view import View


class LessonControls:
    """Question, button and measured answer of each experiment."""

    def __init__(self, view: View, page: Shown, watch: Callable[[str], None]) -> None:
        self._view, self._page, self._watch = view, page, watch
        self._running = False
        for number, experiment in enumerate(EXPERIMENTS, 1):
            with ui.element('section').classes('live-lesson'):
                ui.label(f'{number}. {experiment.title}').classes('live-title')
                ui.label(experiment.question)
                answer = ui.label().classes('live-measured').props(f'id=live-measured-{number}')
                action = partial(self._carry_out, experiment, answer)
                button('Try it', action, 'science', f'live-try-{number}', number == 1, long=True)

    async def _carry_out(self, experiment: GuidedExperiment, answer: ui.label) -> str:
        if self._view.read_only:
            raise ValueError(READ_ONLY)
        if self._running:
            raise ValueError('another experiment is running; wait for its answer')
        self._running, answer.text = True, 'measuring …'
        try:
            laboratory = Laboratory(self._view, self._page.namespace, self._watch)
            answer.text = await experiment.carry_out(laboratory)
        except (TimeoutError, ValueError) as error:
            answer.text = ''
            raise ValueError(str(error)) from error
        finally:
            self._running = False
        return f'measured: {experiment.title}'
