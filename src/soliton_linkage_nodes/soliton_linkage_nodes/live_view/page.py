# SPDX-License-Identifier: Apache-2.0
"""Live page with controls and plots."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from nicegui import ui

from soliton_linkage_nodes.live_view.controls.bag_controls import BagControls, RecordControls
from soliton_linkage_nodes.live_view.controls.drive_controls import (
    DriveControls,
    RunControls,
    Shown,
    button,
    reasons_for,
)
from soliton_linkage_nodes.live_view.controls.node_controls import (
    IdentifyControls,
    ParameterControls,
)
from soliton_linkage_nodes.live_view.controls.wave_controls import WaveControls
from soliton_linkage_nodes.live_view.lesson import EXPERIMENTS, GuidedExperiment, Laboratory
from soliton_linkage_nodes.live_view.status import REPLAY
from soliton_linkage_nodes.live_view.view import ALL, View


class LessonControls:
    """Question, button and measured answer of each guided experiment."""

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
        if self._running:
            raise ValueError('another experiment is running; wait for its answer')
        self._running, answer.text = True, 'measuring …'
        try:
            laboratory = Laboratory(self._view, self._page.namespace, self._watch)
            measured = await experiment.carry_out(laboratory)
            answer.text = measured.replace('-', '−')
        except (TimeoutError, ValueError) as error:
            answer.text = ''
            raise ValueError(str(error)) from error
        finally:
            self._running = False
        return f'measured: {experiment.title}'


_REFRESH_PERIOD = 0.25
"""Time between two updates of the controls [s]."""
_BUILD_TIMEOUT = 60.0
"""Time limit for building a page [s], sufficient on a busy machine."""
_RECONNECT_TIMEOUT = 15.0
"""Longest interruption of the connection after which a browser keeps its page [s]."""
_TABS = {
    'Drive': 'Push, move or tilt the chain. The answer to each command is shown here.',
    'Run': 'Pause, step, reset, speed up or slow down a simulated chain.',
    'Settings': 'Change parameters of a node. A node is one of the programs that run together, '
    'such as the simulator or the analyser.',
    'Bags': 'Record and replay. A bag is a recording of the topics, that is, of all angles, '
    'results and commands.',
    'Identify': 'Estimate the lengths of the rotors and springs of this chain from its motion.',
}
"""Explanation of each tab. It takes at most three lines on the page."""
_EXPERIMENTS = 'Five experiments. Each asks a question, and measures the answer on this chain.'
_LESSON = 'Lesson'
_LESSON_TABS = (_LESSON, 'Drive', 'Run')
_SHARING = (
    ('photo_camera', 'save the view as a picture', 'window.live?.savePicture()'),
    ('download', 'save the last minute as one HTML file', 'window.live?.saveMinute()'),
)
_WARNING = '<button type="button" class="{}" popovertarget="live-warnings" hidden></button>'
_PLOTS = Path(__file__).with_name('browser') / 'plots.html'
_MARKDOWN = ['fenced-code-blocks', 'header-ids', 'tables']
_DOCUMENTS = Path(__file__).with_name('docs')


def add(served: FastAPI, view: View, lesson: bool) -> None:
    """Add the page to a web application. With `lesson`, it begins with guided experiments."""
    plots = _PLOTS.read_text(encoding='utf-8')

    @ui.page('/', response_timeout=_BUILD_TIMEOUT)
    async def index() -> None:
        await Page(view, lesson).build(plots)

    @ui.page('/docs/{name}')
    def document(name: str) -> None:
        pages = {path.name: path for path in _DOCUMENTS.glob('*.md')}
        if name not in pages:
            ui.label(f'The documentation has no page {name!r}.')
            return
        with ui.element('main').classes('live-document'):
            ui.markdown(pages[name].read_text(encoding='utf-8'), extras=_MARKDOWN)

    ui.run_with(
        served,
        title='Soliton chain, live',
        favicon='〰️',
        dark=None,
        language='en-US',
        binding_refresh_interval=None,
        show_welcome_message=False,
        reconnect_timeout=_RECONNECT_TIMEOUT,
        gzip_middleware_factory=None,
    )


class Page:
    """Page in one browser. Initially it shows the first chain."""

    def __init__(self, view: View, lesson: bool) -> None:
        self._view = view
        self._in_lesson = lesson
        self.namespace = next(iter(view.chains), '')
        """Namespace of the shown chain, '' if no chain or every chain is shown."""
        self._options: dict[str, str] = {}
        self._replaying = False
        self._dark = ui.dark_mode(None)

    async def build(self, plots: str) -> None:
        """Build the page. `plots` is the HTML text of the plots.

        The page is built in steps, because the same thread sends frames to other browsers.
        """
        ui.add_head_html(
            '<link rel="stylesheet" href="/live/live.css">'
            '<script type="module" src="/live/live.js"></script>'
        )
        ui.colors(primary='#0072b2', positive='#00785a', negative='#b00020')
        with ui.element('main').classes('live'):
            self._header()
            ui.html(plots, sanitize=False).classes('live-plots')
            with ui.element('aside').classes('live-controls'):
                await self._controls()
        ui.on('live-chosen', lambda event: self._choose(str(event.args)))
        ui.timer(_REFRESH_PERIOD, self._refresh)

    def _header(self) -> None:
        with ui.element('header').classes('live-header'):
            ui.html('<h1>Soliton chain, live</h1>', sanitize=False)
            self._chooser = ui.select({}, label='chain').props(
                'dense outlined options-dense id=live-chooser'
            )
            self._chooser.on_value_change(lambda event: self._choose(event.value))
            ui.html(
                '<div id="live-health" role="status" aria-live="polite">'
                + ''.join(map(_WARNING.format, ('warning', 'warning more')))
                + '</div>',
                sanitize=False,
            ).classes('live-health-area')
            if self._view.read_only:
                ui.label('read-only').classes('live-badge')
            for icon, label, script in _SHARING:
                shared = ui.button(icon=icon, on_click=partial(ui.run_javascript, script))
                _explain(shared.props('flat dense round'), label)
            lessons = ui.button('Lessons', icon='school', on_click=self._toggle_lesson)
            _explain(
                lessons.props('flat dense no-caps id=live-lesson'), 'lessons: guided experiments'
            )
            dark = ui.button(icon='contrast', on_click=self._toggle_dark)
            _explain(dark.props('flat dense round id=live-dark'), 'light or dark background')

    async def _controls(self) -> None:
        view = self._view
        with ui.element('div').classes('live-controls-head'):
            with ui.tabs().props('dense no-caps align=justify inline-label') as tabs:
                self._tabs = {name: ui.tab(name) for name in (*_TABS, _LESSON)}
            self._tab_row = tabs
            with ui.element('div').classes('live-answer-area'):
                ui.element('div').classes('live-answer').props('id=live-answer tabindex=0')
                explanation = ui.label(_TABS['Drive']).classes('live-tab-hint')
        with ui.tab_panels(tabs, value='Drive', animated=False, keep_alive=True).classes(
            'live-panels'
        ):
            with ui.tab_panel('Drive'):
                self._drive = DriveControls(view, self)
                await asyncio.sleep(0)
                self._waves = WaveControls(view, self)
                await asyncio.sleep(0)
            with ui.tab_panel('Run'):
                self._run = RunControls(view, self)
                await asyncio.sleep(0)
            with ui.tab_panel('Settings'):
                self._parameters = ParameterControls(view, self)
            with ui.tab_panel('Bags'):
                self._record = RecordControls(view, self)
                await asyncio.sleep(0)
                self._bags = BagControls(view)
            with ui.tab_panel('Identify'):
                self._identify = IdentifyControls(view, self)
            with ui.tab_panel(_LESSON):
                LessonControls(view, self, self._choose)
        self._show_lesson()
        ui.timer(0.1, self._bags.list_bags, once=True)

        async def on_tab(event: Any) -> None:
            explanation.text = _TABS.get(event.value, _EXPERIMENTS)
            if event.value == 'Bags':
                await self._bags.list_bags()

        tabs.on_value_change(on_tab)

    def _toggle_dark(self) -> None:
        dark = self._dark.value
        self._dark.value = True if dark is None else not dark

    def _toggle_lesson(self) -> None:
        self._in_lesson = not self._in_lesson
        self._show_lesson()

    def _show_lesson(self) -> None:
        lesson = self._in_lesson
        for name, tab in self._tabs.items():
            tab.set_visibility(name in _LESSON_TABS if lesson else name != _LESSON)
        self._tab_row.value = _LESSON if lesson else 'Drive'
        ui.query('body').classes(
            add='live-in-lesson' if lesson else '', remove='' if lesson else 'live-in-lesson'
        )

    def _choose(self, namespace: str) -> None:
        if namespace != ALL and namespace not in self._view.chains:
            return
        self.namespace = '' if namespace == ALL else namespace
        self._chooser.value = namespace
        ui.run_javascript(f'window.live?.watch({namespace!r})')

    def _refresh(self) -> None:
        chains = self._view.chains
        options = {name: _title(name) for name in chains}
        if len(options) > 1:
            options[ALL] = 'all side by side'
        if options != self._options:
            self._options = options
            self._chooser.set_options(options)
        replay = self._view.replay
        replaying = replay.bag is not None and replay.namespace in chains
        if replaying and not self._replaying:
            self._choose(replay.namespace)
        self._replaying = replaying
        if self._chooser.value not in options:
            self._choose(self.namespace if self.namespace in chains else next(iter(chains), ''))
        why = reasons_for(self._view, self.namespace)
        for controls in (self._drive, self._waves, self._run, self._identify):
            controls.refresh(why)
        for others in (self._parameters, self._record, self._bags):
            others.refresh()


def _explain(control: ui.button, text: str) -> None:
    """Add a tooltip to a button, and the same text for screen readers."""
    with control.props(f'aria-label="{text}"'):
        ui.tooltip(text)


def _title(namespace: str) -> str:
    if namespace.startswith(REPLAY):
        return f'replay {namespace.removeprefix(REPLAY).strip("/")}'.strip()
    return namespace.strip('/') or 'chain'
