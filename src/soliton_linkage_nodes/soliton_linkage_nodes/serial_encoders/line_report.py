# SPDX-License-Identifier: Apache-2.0
"""How a serial line is doing, second by second."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from soliton_linkage.microcontroller.frames import FrameDecoder
from soliton_linkage.microcontroller.rotary_encoders import AngleStream
from soliton_linkage_nodes.runtime.diagnostics import Report

_LONGEST_DELAY = 0.5
"""Of a frame that is no warning yet [s]: by then the analyser skips frames, too."""


@dataclass
class LineAccount:
    """What has come on a line since the node began, whatever became of the port."""

    bytes: int = 0
    frames: int = 0
    corrupted: int = 0
    lost: int = 0
    restarts: int = 0
    seconds: float = 0.0
    """When it was so, by the monotonic clock [s]."""

    @classmethod
    def now(cls, taken: int, decoder: FrameDecoder, stream: AngleStream) -> LineAccount:
        """Account of what a decoder and a stream have seen of so many bytes."""
        return cls(
            taken,
            decoder.frames,
            decoder.corrupted,
            stream.lost,
            stream.clock.restarts,
            time.monotonic(),
        )


def line_in_words(
    now: LineAccount,
    before: LineAccount,
    port: str,
    decoder: FrameDecoder,
    stream: AngleStream,
    commands: int,
) -> Report:
    """Report on what has come since another account, and on the commands so far."""
    elapsed = max(now.seconds - before.seconds, 1e-9)
    frames = now.frames - before.frames
    drift, scatter = 1e6 * stream.clock.drift, stream.clock.scatter
    values: dict[str, Any] = {
        'rate [Hz]': frames / elapsed,
        'frames': now.frames,
        'frames lost': now.lost,
        'frames corrupted': now.corrupted,
        'restarts of the controller': now.restarts,
        'commands to the valves': commands,
        'drift of the controller [ppm]': drift,
        'delay [s]': stream.clock.delay,
    }
    if not math.isnan(scatter):
        values['stamps sure to [s]'] = scatter
    if not frames:
        heard = now.bytes - before.bytes
        silent = f'waiting for frames on {port}'
        noise = f'{heard} bytes and no frame on {port}; check baud_rate and the protocol'
        return Report(noise if heard else silent, values, warning=True)
    protocol = decoder.protocol.value if decoder.protocol is not None else 'no'
    told = [f'{now.lost - before.lost} frames were lost'] if now.lost > before.lost else []
    if now.corrupted > before.corrupted:
        told.append(
            f'{now.corrupted - before.corrupted} frames were corrupted: {decoder.complaint}'
        )
    if now.restarts > before.restarts:
        told.append(f'the clock of the controller has begun anew, {now.restarts} times in all')
    if stream.clock.delay > _LONGEST_DELAY:
        told.append(
            f'frames are {stream.clock.delay:.2g} s late, or the times of the controller are no '
            'microseconds'
        )
    return Report('; '.join(told) or f'hearing {protocol} frames on {port}', values, bool(told))
