# SPDX-License-Identifier: Apache-2.0
"""What the page shows, and how it looks, in a browser with the nodes of the suite behind it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from live_stage import PLACE, ROTORS, Visit, until
from matplotlib import colormaps

from soliton_linkage_studies import palette
from soliton_linkage_studies.drawing import lean_norm

PANELS = ('chain', 'lean', 'kymograph', 'dial', 'energy', 'topology')


def wait_for_place(visit: Visit, note: str, told: str) -> None:
    """The wall goes on settling while the page is read."""

    def there() -> bool:
        place = re.search(rf'{told}([0-9.]+)', visit.text(note))
        return place is not None and abs(float(place[1]) - PLACE) < 0.1

    until(there, f'the place in {note}')


def test_every_panel_shows_what_was_published(at_rest: Visit, view: Any) -> None:
    visit = at_rest
    model = view.finder.chains['/'].model
    visit.wait(f'Math.abs(live.shown.rotor - {PLACE}) < 0.1 && live.shown.age < 0.5')
    shown = visit.js('({...live.shown, angles: [...live.shown.angles]})')
    np.testing.assert_allclose(shown['angles'], model.angles, atol=1e-4)
    assert shown['rotors'] == ROTORS
    assert shown['charge'] == 1
    assert (shown['winding_before'], shown['winding_beyond']) == (0, 1)
    assert 'flipper · 12 rotors' in visit.text('chain-note')
    assert 'charge 1' in visit.text('topology-note')
    for note, told in (
        ('chain', 'soliton at rotor '),
        ('topology', 'zero mode at '),
        ('lean', 'wall at '),
    ):
        wait_for_place(visit, f'{note}-note', told)
    for canvas in PANELS:
        assert visit.painted(canvas) > 5, canvas
    column = visit.js(
        """(() => { const t = live.track(0); const at = t.at(t.newest);
        return [...t.image.subarray(at * t.height, (at + 1) * t.height)]; })()"""
    )
    lean = view.finder.chains['/'].model.named.chain.positions(model.angles)[0]
    np.testing.assert_allclose(column, lean, atol=1e-4)
    assert 'Hz' in visit.text('health')
    assert not visit.page.locator('#live-stale').is_visible()
    visit.shot('chain_light')


def test_its_colours_are_those_of_the_figures(visit: Visit, view: Any) -> None:
    own = visit.page.evaluate('async () => (await import("/live/drawing.js")).COLOURS')
    assert own == {name: getattr(palette, name.upper()) for name in own}
    chain = view.finder.chains['/'].model.named.chain
    leans = np.linspace(-1, 1, 41) * chain.rotor_length
    drawn = visit.page.evaluate(
        """async (leans) => { const { leanColour } = await import('/live/drawing.js');
        const { lean } = live.known(0);
        return leans.map((u) => leanColour(lean(u)).match(/[0-9]+/g).map(Number)); }""",
        leans.tolist(),
    )
    figures = colormaps[palette.LEAN_COLOURS](lean_norm(chain)(leans))[:, :3]
    np.testing.assert_allclose(drawn, 255 * figures, atol=4)


def test_zoom_pan_and_all(visit: Visit) -> None:
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


def test_two_browsers_see_the_same_and_choose_for_themselves(
    visit: Visit, open_page: Callable[..., Visit], view: Any
) -> None:
    other = open_page(color_scheme='dark', has_touch=True)
    assert len(view.streams) == 2
    past = 'live.tracks.get("/").energies[0].filter(Number.isFinite).length'
    other.wait(f'{past} > 2 * live.drawn + 10')
    assert visit.js('live.watched') == other.js('live.watched') == '/'
    before = visit.js('live.drawn')
    visit.wait(f'live.drawn > {before + 5}')
    assert other.js('document.body.classList.contains("body--dark")')
    other.shot('desktop_dark')
    check_phone(other, 'dark')
    other.close()
    until(lambda: len(view.streams) == 1, 'the other to be gone')
    assert other.console == []


def test_a_phone_shows_all_of_it_one_below_the_other(visit: Visit) -> None:
    visit.shot('desktop_light')
    check_phone(visit, 'light')
    visit.resize(1400, 1000)


def check_phone(visit: Visit, scheme: str) -> None:
    visit.resize(390, 844)
    assert visit.js('document.documentElement.scrollWidth') == 390
    above = visit.page.locator('#live-nudge').bounding_box()['y']
    assert above < visit.page.locator('#live-lean').bounding_box()['y']
    for name in PANELS:
        box = visit.page.locator(f'#live-{name}').bounding_box()
        assert box['x'] >= 0
        assert box['x'] + box['width'] <= 390
    visit.shot(f'phone_{scheme}')


def test_light_and_dark_are_changed_by_a_button(visit: Visit) -> None:
    visit.click('dark')
    visit.wait('document.body.classList.contains("body--dark")')
    visit.click('dark')
    visit.wait('!document.body.classList.contains("body--dark")')


def test_no_other_file_is_served(visit: Visit, view: Any) -> None:
    for path in (
        'live/../node.py',
        'live/plots.html',
        'live/%2e%2e/node.py',
        'docs',
        'openapi.json',
    ):
        answer = visit.page.request.get(f'http://127.0.0.1:{view.port}/{path}')
        assert answer.status == 404 or 'LiveView' not in answer.text(), path


def test_a_place_stands_where_it_belongs_however_late_it_is_told(visit: Visit) -> None:
    place, late, energy = visit.page.evaluate(
        """async () => { const { Track } = await import('/live/frames.js');
        const track = new Track(['kinetic']);
        for (let t = 5; t <= 6; t += 0.02) {
          track.put(t, [0, 1]);
          track.tell(t - 0.4, 10 * t, [t]);
        }
        const at = (t) => track.at(Math.floor(30 * t));
        return [track.places[at(5.51)], track.places[at(5.95)], track.energies[0][at(5.51)]]; }"""
    )
    assert place == pytest.approx(10 * 5.91, abs=0.5)
    assert math.isnan(late)
    assert energy == pytest.approx(5.91, abs=0.05)
