# SPDX-License-Identifier: Apache-2.0
"""The page of a filmed experiment: film, overlay, report and track side by side."""

from __future__ import annotations

import html
from pathlib import Path

_PAGE = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<title>A soliton in a film</title>
<style>
body {{ font-family: sans-serif; margin: 1em; color: #3a3a3a; }}
main {{ display: grid; grid-template-columns: 1fr 1fr; gap: 1em; }}
figure {{ margin: 0; }}
video, img {{ width: 100%; }}
</style>
<h1>A soliton in a film</h1>
<p>{words}</p>
<main>{figures}</main>
<script>
// Both films show the same instant.
const films = document.querySelectorAll('video');
for (const film of films) for (const event of ['play', 'pause', 'seeked'])
  film.addEventListener(event, () => {{
    for (const other of films) if (other !== film) {{
      if (Math.abs(other.currentTime - film.currentTime) > 0.05)
        other.currentTime = film.currentTime;
      if (event === 'play') other.play(); else if (event === 'pause') other.pause();
    }}
  }});
</script>
</html>
"""
_FIGURES = (
    ('film.mp4', 'The film, as a camera takes it.'),
    ('overlay.mp4', 'The same with the markers that were found, and the soliton.'),
    ('identification.png', 'The chain that the film shows: its lengths, and what bonds leave.'),
    ('track.png', 'Place and velocity of the soliton on that chain.'),
)
"""Files of the page, in its folder, and what is said of them."""


def write_film_page(folder: Path, words: str) -> None:
    """Write index.html into a folder that has the films and pictures."""
    figures = ''.join(_figure(name, caption) for name, caption in _FIGURES)
    page = _PAGE.format(words=html.escape(words), figures=figures)
    (folder / 'index.html').write_text(page, encoding='utf-8')


def _figure(name: str, caption: str) -> str:
    shown = (
        f'<video src="{name}" controls muted loop></video>'
        if name.endswith('.mp4')
        else f'<img src="{name}" alt="">'
    )
    return f'<figure>{shown}<figcaption>{html.escape(caption)}</figcaption></figure>'
