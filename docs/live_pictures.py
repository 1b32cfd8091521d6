# SPDX-License-Identifier: Apache-2.0
"""Picture and film of the live page for the README, recorded with a browser.

The commands

    make shell
    python3 docs/live_pictures.py

write live.png and live.gif into docs/pictures.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import imageio_ffmpeg
from PIL import Image
from playwright.sync_api import sync_playwright

from soliton_linkage_nodes.runtime.child_processes import private_domain

HERE = Path(__file__).parent / 'pictures'
CONFIGURATION = HERE.parents[1] / 'config' / 'flipper.yaml'
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
SIZE = {'width': 1400, 'height': 1010}
LEFT, RIGHT, SPEED = 8.5, 28.0, 5.0
SLOWNESS = 4
RATE, LENGTH, WIDTH = 3, 6.0, 640
SPAN = 20.0
COLOURS = 96
START_LIMIT = 60.0
NICENESS = 10


def main() -> None:
    """Record live.png and live.gif."""
    browser_path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser_path is None:
        sys.exit(f'live_pictures: none of {", ".join(BROWSERS)} is installed')
    with (
        private_domain(),
        tempfile.TemporaryDirectory() as folder,
        served(Path(folder)) as address,
    ):
        # The browser has a lower priority than the nodes, because a screenshot would delay frames.
        os.nice(NICENESS)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=browser_path, args=['--no-sandbox']
            )
            page = browser.new_page(viewport=SIZE)
            page.goto(address)
            page.wait_for_function('() => window.live && live.drawn > 10')
            page.get_by_label('hide the first steps').click()
            # The picture shows the whole page.
            height = page.evaluate('document.documentElement.scrollHeight')
            page.set_viewport_size({**SIZE, 'height': height})
            film(page, Path(folder))
            browser.close()
    sys.stdout.write(f'{HERE / "live.png"}\n{HERE / "live.gif"}\n')


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Start the live page with a simulated chain and yield the address of the page.

    The simulated time advances at 1 / SLOWNESS of real time, because screenshots take so much
    processor time that frames would be late otherwise.
    """
    slow = folder / CONFIGURATION.name
    rate = '    publish_rate:'
    factor = f'    real_time_factor: {1 / SLOWNESS}\n'
    slow.write_text(CONFIGURATION.read_text().replace(rate, factor + rate))
    command = ['live', str(slow), '--output', str(folder / 'live'), '--no-browser']
    process = subprocess.Popen(
        [*command, '--port', '0'], stdout=subprocess.PIPE, text=True, env=os.environ
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            found = re.search(r'http://\S+?(?=;|\s)', line)
            if found:
                yield found[0]
                break
        else:
            raise RuntimeError('live ended without an address')
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(START_LIMIT)


def film(page: Any, folder: Path) -> None:
    """Move a soliton from LEFT to RIGHT and back, and film the way back; `folder` is temporary."""
    page.get_by_role('tab', name='Run').click()
    page.locator('label.q-select:visible:has-text("state")').click()
    page.get_by_role('option', name='soliton', exact=True).click()
    page.locator('.q-tab-panel:visible').get_by_label('position', exact=True).fill(str(LEFT))
    page.click('#live-reset')
    page.get_by_role('tab', name='Drive').click()
    page.wait_for_function(f'() => Math.abs(live.shown.rotor - {LEFT}) < 0.1')
    reset = time.monotonic()
    page.wait_for_timeout(3000 * SLOWNESS)
    page.evaluate(f'live.act("move", {{rotor: {RIGHT}, speed: {SPEED}}})')
    page.wait_for_function(
        '() => document.getElementById("live-move").textContent[0] === "r"', timeout=120e3
    )
    # Wait until the reset has left the plotted history.
    shown = reset + SLOWNESS * (SPAN - LENGTH / 2)
    page.wait_for_timeout(1e3 * (shown - time.monotonic()))
    page.evaluate(f'live.act("move", {{rotor: {LEFT}, speed: {SPEED}}})')
    begun = time.monotonic()
    number = late = 0
    while (elapsed := (time.monotonic() - begun) / SLOWNESS) < LENGTH:
        page.wait_for_timeout(max(0.0, 1e3 * SLOWNESS * (number / RATE - elapsed)))
        page.screenshot(path=folder / f'{number:03}.png')
        number += 1
        late += page.locator('#live-health .late').count()
    if late:
        sys.exit(
            f'live_pictures: {late} pictures warn of late frames; repeat it on a quiet computer'
        )
    picture = Image.open(folder / f'{number // 2:03}.png').convert('RGB')
    picture.quantize(256, dither=Image.Dither.NONE).save(HERE / 'live.png', optimize=True)
    palette = (
        f'split[a][b];[a]palettegen=max_colors={COLOURS}:stats_mode=diff[p];'
        '[b][p]paletteuse=dither=none'
    )
    subprocess.run(
        [
            *(imageio_ffmpeg.get_ffmpeg_exe(), '-loglevel', 'error', '-y'),
            *('-framerate', f'{number / LENGTH:.3f}', '-i', str(folder / '%03d.png')),
            *('-vf', f'scale={WIDTH}:-1:flags=lanczos,{palette}', str(HERE / 'live.gif')),
        ],
        check=True,
    )


if __name__ == '__main__':
    main()
