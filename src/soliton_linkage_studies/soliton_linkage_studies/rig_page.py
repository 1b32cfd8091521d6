# SPDX-License-Identifier: Apache-2.0
"""Self-contained page that reports the check of a rig."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from soliton_linkage.identification.rig_check import DOUBTFUL, RIGHT, WRONG, RigFindings
from soliton_linkage_studies.palette import BLUE, GREEN, ORANGE, RED

_PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>Check of the rig</title>
<style>body {{font: 16px/1.4 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em}}
td {{padding: .3em .8em .3em 0; vertical-align: top}} svg {{max-width: 100%; height: auto}}</style>
<h1>Check of the rig: {verdict}</h1><p>{chain}; joints {joints}.</p>
<table>{rows}</table>{picture}</html>
"""


def rig_page(found: RigFindings, names: Sequence[str], chain: str) -> str:
    """Return the page as HTML; `names` are the joint names and `chain` describes the chain."""
    colours = {RIGHT: GREEN, DOUBTFUL: ORANGE, WRONG: RED}
    rows = ''.join(
        f'<tr><td style="color:{colours[each.verdict]}"><b>{each.verdict}</b></td>'
        f'<td>{each.subject}</td><td>{html.escape(each.text)}</td></tr>\n'
        for each in found.findings
    )
    figure = Figure(figsize=(9, 4.5), layout='constrained')
    above, below = figure.subplots(2, 1, sharex=True)
    above.bar(np.arange(len(found.noise)), found.noise, color=BLUE)
    above.set(ylabel='noise [rad]')
    below.bar(np.arange(len(found.stretches)) + 0.5, 100 * found.stretches, color=BLUE)
    below.set(xlabel='rotor n [1]', ylabel='bond length minus\nconfigured length [%]')
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    picture = io.StringIO()
    figure.savefig(picture, format='svg', metadata={'Date': None})
    return _PAGE.format(
        verdict='nothing is wrong' if found.sound else 'something is wrong',
        chain=html.escape(chain[:1].upper() + chain[1:]),
        joints=html.escape(f'{names[0]} to {names[-1]}'),
        rows=rows,
        picture=picture.getvalue().partition('?>')[2].partition('.dtd">')[2],
    )
