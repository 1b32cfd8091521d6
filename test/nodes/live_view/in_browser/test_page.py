# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_stage import PLACE, ROTORS, Visit
from matplotlib import colormaps
from programs import until

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.live_view.sharing import shared_page
from soliton_linkage_studies import palette
from soliton_linkage_studies.drawing import lean_norm

PANELS = ('chain', 'lean', 'kymograph', 'dial', 'energy', 'topology')


def wait_for_position(visit: Visit, note: str, label: str) -> None:
    """Wait until a note shows the position, because the soliton still settles."""

    def there() -> bool:
        place = re.search(rf'{label}([0-9.]+)', visit.text(note))
        return place is not None and abs(float(place[1]) - PLACE) < 0.1

    until(there, f'the position in {note}')


def test_every_panel_shows_the_published_state(at_rest, view):
    visit = at_rest
    model = view.chains['/'].model
    visit.wait(f'Math.abs(live.shown.rotor - {PLACE}) < 0.1 && live.shown.age < 0.5')
    shown = visit.js('({...live.shown, angles: [...live.shown.angles]})')
    np.testing.assert_allclose(shown['angles'], model.angles, atol=1e-4)
    assert shown['rotors'] == ROTORS
    assert shown['charge'] == 1
    assert (shown['winding_before'], shown['winding_beyond']) == (0, 1)
    assert 'flipper · 12 rotors' in visit.text('chain-note')
    assert 'charge 1' in visit.text('topology-note')
    for note, label in (
        ('chain', 'soliton at rotor '),
        ('topology', 'zero mode at '),
        ('lean', 'soliton at '),
    ):
        wait_for_position(visit, f'{note}-note', label)
    for canvas in PANELS:
        assert visit.colours(canvas) > 5, canvas
    column = visit.js(
        """(() => { const t = live.track(0); const at = t.at(t.newest);
        return [...t.image.subarray(at * t.height, (at + 1) * t.height)]; })()"""
    )
    lean = view.chains['/'].model.named.chain.positions(model.angles)[0]
    np.testing.assert_allclose(column, lean, atol=1e-4)
    assert 'frames/s' in visit.text('health')
    assert not visit.page.locator('#live-stale').is_visible()


def test_the_colours_equal_those_of_the_figures(visit, view):
    own = visit.page.evaluate('async () => (await import("/live/drawing.js")).COLOURS')
    assert own == {name: getattr(palette, name.upper()) for name in own}
    chain = view.chains['/'].model.named.chain
    leans = np.linspace(-1, 1, 41) * chain.rotor_length
    drawn = visit.page.evaluate(
        """async (leans) => { const { leanColour } = await import('/live/drawing.js');
        const { lean } = live.known(0);
        return leans.map((u) => leanColour(lean(u)).match(/[0-9]+/g).map(Number)); }""",
        leans.tolist(),
    )
    figures = colormaps[palette.LEAN_COLOURS](lean_norm(chain)(leans))[:, :3]
    np.testing.assert_allclose(drawn, 255 * figures, atol=4)


def test_the_chain_is_zoomed_and_panned(visit):
    visit.page.mouse.move(*visit.place(6.0))
    visit.page.mouse.wheel(0, -300)
    visit.wait('live.view.last - live.view.first < 11')
    visit.wait('live.shown.angles.length <= live.shown.rotors')
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('+')
    visit.page.keyboard.press('PageDown')
    visit.page.keyboard.press('0')
    assert visit.js('live.view.last - live.view.first') == pytest.approx(
        ROTORS - 1 + 2 * visit.js('live.view.margin')
    )


def test_two_browsers_have_independent_pages(visit, open_page, live_view):
    other = open_page(color_scheme='dark', has_touch=True)
    assert len(live_view.streams) == 2
    past = 'live.tracks.get("/").energies[0].filter(Number.isFinite).length'
    other.wait(f'{past} > 2 * live.drawn + 10')
    assert visit.js('live.watched') == other.js('live.watched') == '/'
    before = visit.js('live.drawn')
    visit.wait(f'live.drawn > {before + 5}')
    assert other.js('document.body.classList.contains("body--dark")')
    check_phone(other)
    other.close()
    until(lambda: len(live_view.streams) == 1, 'the end of the other stream')
    assert other.console == []


def check_phone(visit: Visit) -> None:
    """Check that a phone shows the panels in one column."""
    visit.resize(390, 844)
    assert visit.js('document.documentElement.scrollWidth') == 390
    above = visit.page.locator('#live-nudge').bounding_box()['y']
    assert above < visit.page.locator('#live-lean').bounding_box()['y']
    for name in PANELS:
        box = visit.page.locator(f'#live-{name}').bounding_box()
        assert box['x'] >= 0
        assert box['x'] + box['width'] <= 390


def test_a_button_toggles_the_dark_background(visit):
    visit.click('dark')
    visit.wait('document.body.classList.contains("body--dark")')
    visit.click('dark')
    visit.wait('!document.body.classList.contains("body--dark")')


def test_other_files_are_not_served(visit, live_view):
    for path in (
        'live/../node.py',
        'live/plots.html',
        'live/%2e%2e/node.py',
        'docs',
        'openapi.json',
    ):
        answer = visit.page.request.get(f'http://127.0.0.1:{live_view.port}/{path}')
        assert answer.status == 404 or 'LiveView' not in answer.text(), path


def test_an_address_with_the_punctuation_of_a_sentence_opens_the_page(visit, live_view):
    for mark in ('', ';', '.', ').'):
        answer = visit.page.request.get(f'http://127.0.0.1:{live_view.port}/{mark}')
        assert answer.status == 200
        assert 'Soliton chain, live' in answer.text()


def test_a_late_state_is_drawn_at_its_own_stamp(visit):
    position, late, energy = visit.page.evaluate(
        """async () => { const { Track } = await import('/live/frames.js');
        const track = new Track(['kinetic']);
        for (let t = 5; t <= 6; t += 0.02) {
          track.addAngles(t, [0, 1]);
          track.addState(t - 0.4, 10 * t, [t]);
        }
        const at = (t) => track.at(Math.floor(30 * t));
        const { positions, energies } = track;
        return [positions[at(5.51)], positions[at(5.95)], energies[0][at(5.51)]]; }"""
    )
    assert position == pytest.approx(10 * 5.91, abs=0.5)
    assert math.isnan(late)
    assert energy == pytest.approx(5.91, abs=0.05)


def test_the_columns_that_a_slow_browser_skipped_fill_the_track(visit):
    before, between, after = visit.page.evaluate(
        """async () => { const { Track } = await import('/live/frames.js');
        const track = new Track(['kinetic']);
        const times = Array.from({ length: 60 }, (_, n) => 5.01 + n / 30);
        const load = (shift) => track.load({ columns: times.length, height: 2, count: 4,
          numbers: new Float64Array(times.flatMap((t) => Array(4).fill(t + shift))),
          data: new Float32Array(times.flatMap((t) => [0, t])) });
        const at = (t) => track.positions[track.at(Math.floor(30 * t))];
        load(0);
        load(2);
        const kept = [at(5.51), at(7.51)];
        load(-4);
        return [...kept, at(7.51)]; }"""
    )
    assert before == pytest.approx(5.51, abs=0.05)
    assert between == pytest.approx(7.51, abs=0.05)
    assert math.isnan(after)


def test_the_view_and_the_last_minute_are_saved(visit, stage):
    with visit.page.expect_download() as saved:
        visit.page.get_by_label('save the view as a picture').click()
    picture = Path(saved.value.path()).read_bytes()
    assert picture.startswith(b'\x89PNG')
    assert len(picture) > 10_000
    with visit.page.expect_download() as saved:
        visit.page.get_by_label('save the last minute as one HTML file').click()
    path = stage.folder / 'minute.html'
    saved.value.save_as(path)
    opened = visit.page.context.new_page()
    opened.goto(path.as_uri())
    opened.wait_for_function('() => window.shared && shared.times.length > 20')
    assert opened.evaluate('shared.rotors') == ROTORS
    opened.locator('#live-share-kymograph').click(position={'x': 300, 'y': 100})
    assert opened.evaluate('shared.n') > 0
    opened.close()


def test_the_first_steps_go_on_with_each_success(at_rest):
    visit = at_rest
    visit.js('localStorage.clear()')
    visit.load()
    visit.has_text('guide', 'Nudge the edge to send a soliton.')
    visit.page.locator('.live-guide-act').click()
    visit.has_text('guide', 'Click on the chain to move the soliton there.')
    visit.load()
    visit.has_text('guide', 'Click on the chain to move the soliton there.')
    # A later step completes all steps before it.
    visit.js('live.guide.done.clear()')
    visit.js("live.act('move', {rotor: 7})")
    visit.has_text('guide', 'Drag a rotor')
    # The texts of a move in progress shift the button, which then misses the end of a click.
    visit.has_text('move', 'reached')
    visit.page.get_by_label('hide the first steps').click()
    visit.wait('document.getElementById("live-guide").hidden')


def test_the_answer_is_visible_beside_the_last_control(visit):
    visit.resize(1280, 720)
    visit.tab('Drive')
    visit.page.locator('#live-wave').scroll_into_view_if_needed()
    visit.js("live.answers.show({id: 1, name: 'Test', answer: 'the answer', good: false})")
    box = visit.page.locator('#live-answer').bounding_box()
    panel = visit.page.locator('.live-controls').bounding_box()
    assert panel['y'] <= box['y'] < panel['y'] + panel['height']
    visit.resize(1400, 1000)


def test_a_shared_kymograph_is_drawn_at_the_times_of_its_frames(visit, stage):
    # Frames of a busy computer are not equidistant.
    chain = Chain(number_of_rotors=4)
    times = np.array([0.0, 0.1, 0.2, 0.3, 1.0, 1.1])
    leans = np.where(times < 0.25, 1, -1)
    angles = np.array([chain.uniform_state(lean) for lean in leans])
    path = stage.folder / 'uneven.html'
    path.write_text(shared_page('uneven', chain, times, angles, [[]] * 6), encoding='utf-8')
    opened = visit.page.context.new_page()
    opened.goto(path.as_uri())
    opened.wait_for_function('() => window.shared')
    columns = opened.evaluate(
        """(() => { const { image, span } = shared;
        const { data } = image.getContext('2d').getImageData(0, 0, image.width, 1);
        return Array.from({ length: image.width }, (_, n) => [
          span[0] + ((n + 0.5) / image.width) * (span[1] - span[0]),
          ...data.slice(4 * n, 4 * n + 3)]);
        })()"""
    )
    first, last = columns[0][1:], columns[-1][1:]
    assert first != last
    for time, *colour in columns:
        assert colour == (first if time < 0.25 else last), time
    opened.close()


def test_each_panel_explains_itself_and_links_to_the_documentation(visit):
    buttons = visit.page.locator('.live-help:visible')
    assert buttons.count() == 7
    for button in buttons.all():
        button.click()
        links = visit.page.locator('.live-help-text:popover-open a')
        with visit.page.context.expect_page() as opened:
            links.last.click()
        opened.value.locator('h1').first.wait_for()
        opened.value.close()
        visit.page.keyboard.press('Escape')


def test_all_plots_are_visible_at_once(at_rest):
    visit = at_rest
    for width, height in ((1280, 720), (1600, 1000)):
        visit.resize(width, height)
        for name in PANELS:
            box = visit.page.locator(f'#live-{name}').bounding_box()
            assert box['y'] >= 0
            assert box['y'] + box['height'] <= height, name
        assert visit.js('document.documentElement.scrollWidth') <= width
    visit.resize(1400, 1000)


def test_the_lesson_shows_its_experiments(visit):
    visit.click('lesson')
    for number in range(1, 6):
        visit.page.locator(f'#live-try-{number}').wait_for()
    visit.click('lesson')
    visit.page.locator('#live-nudge').wait_for()


def test_every_explanation_lies_in_the_window_and_beside_its_panel(visit: Visit) -> None:
    for width, height in ((1280, 720), (1600, 1000)):
        visit.resize(width, height)
        for button in visit.page.locator('.live-help:visible').all():
            # The panels move if a line of text above them appears while the explanation opens.
            until(lambda b=button, w=width, h=height: _explains(visit, b, w, h), 'an explanation')
    visit.resize(1400, 1000)


def _explains(visit: Visit, button: Any, width: int, height: int) -> bool:
    """Open an explanation; return whether it lies in the window and beside its panel."""
    button.click()
    text = visit.page.locator('.live-help-text:popover-open').bounding_box()
    panel = button.locator('xpath=ancestor::figure').bounding_box()
    visit.page.keyboard.press('Escape')
    within = 0 < text['x'] < text['x'] + text['width'] < width
    beside = (
        text['x'] + text['width'] <= panel['x']
        or text['x'] >= panel['x'] + panel['width']
        or text['y'] + text['height'] <= panel['y']
        or text['y'] >= panel['y'] + panel['height']
    )
    return within and beside and 0 < text['y'] < text['y'] + text['height'] < height


def test_texts_of_any_length_move_no_control_and_no_plot(visit: Visit) -> None:
    visit.resize(1280, 720)
    visit.tab('Drive')
    places = """[...document.querySelectorAll('.live-panels button, canvas, .q-tab')]
        .map((e) => { const { x, y, width, height } = e.getBoundingClientRect();
        return [x, y, width, height]; }).filter(([, , width]) => width)"""
    before = visit.js(places)
    for length in (0, 5, 100):
        after = visit.js(
            f"""(() => {{
            const text = 'a long text '.repeat({length});
            live.answers.show({{ id: 1, name: 'Test', answer: text, good: true }});
            const captions = document.querySelectorAll('figcaption span');
            captions.forEach((e) => {{ e.textContent = text; }});
            const banner = document.getElementById('live-stale');
            banner.textContent = 'a banner';
            banner.hidden = {str(length == 0).lower()};
            return {places}; }})()"""
        )
        assert after == before
    visit.resize(1400, 1000)


def test_the_tabs_stay_at_the_top_of_the_scrolled_controls(visit: Visit) -> None:
    visit.resize(1280, 720)
    visit.tab('Drive')
    before = visit.page.get_by_role('tab', name='Drive').bounding_box()
    visit.page.locator('.live-controls').evaluate('e => e.scrollTo(0, 1e4)')
    assert visit.page.locator('.live-controls').evaluate('e => e.scrollTop') > 0
    assert visit.page.get_by_role('tab', name='Drive').bounding_box() == before
    visit.resize(1400, 1000)


def test_a_click_opens_the_complete_text_of_all_warnings(visit: Visit) -> None:
    texts = ['the first warning ' * 20, 'the second warning', 'the third warning']
    visit.js(
        f"""(() => {{ live.readText = (message) => {{
        if (message.status) message.status.failures = {texts};
        live.constructor.prototype.readText.call(live, message); }}; }})()"""
    )
    visit.page.get_by_role('button', name='2 more').click()
    shown = visit.page.locator('#live-warnings')
    assert all(text.strip() in shown.inner_text() for text in texts)
    visit.page.keyboard.press('Escape')
    visit.js('delete live.readText')
    visit.page.get_by_role('button', name='2 more').wait_for(state='hidden')


def test_each_icon_of_the_header_has_a_tooltip(visit: Visit) -> None:
    for button in visit.page.locator('.live-header button:has(i.q-icon):visible').all():
        button.hover()
        text = visit.page.get_by_role('tooltip')
        text.wait_for()
        assert text.inner_text() == button.get_attribute('aria-label')
        visit.page.mouse.move(500, 500)
        text.wait_for(state='hidden')


def test_the_labels_of_a_slider_lie_in_its_group(visit: Visit) -> None:
    visit.tab('Drive')
    for group in visit.page.locator('fieldset:visible:has(.live-slider)').all():
        outer = group.bounding_box()
        labels = group.locator('.q-slider__marker-labels')
        assert labels.count() == 3
        for label in labels.all():
            box = label.bounding_box()
            assert outer['x'] < box['x'] < box['x'] + box['width'] < outer['x'] + outer['width']
