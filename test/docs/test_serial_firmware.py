# SPDX-License-Identifier: Apache-2.0
"""The firmware of the docs sends valid frames, and executes commands until their timeout."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pages import ROOT

from soliton_linkage.microcontroller.frames import (
    FrameDecoder,
    FrameKind,
    Protocol,
    SerialFrame,
    decode_text,
    encode,
)

FIRMWARE = ROOT / 'examples/serial_firmware/serial_firmware.ino'


def compiled(firmware: Path, folder: Path) -> Path:
    """Program that runs the firmware on a simulated Arduino."""
    compiler = shutil.which('c++')
    if compiler is None:
        pytest.skip('needs a C++ compiler: apt install g++')
    program = folder / 'program'
    stage = Path(__file__).with_name('arduino.h')
    included = f'-DFIRMWARE="{firmware}"'
    subprocess.run(
        [compiler, '-Wall', '-Werror', included, '-x', 'c++', stage, '-o', program], check=True
    )
    return program


def test_the_short_firmware_sends_lines_with_checksums(tmp_path):
    page = (ROOT / 'docs/serial.md').read_text(encoding='utf-8')
    code = page.partition('## Short firmware')[2].split('```')[1].removeprefix('cpp')
    firmware = tmp_path / 'short.ino'
    firmware.write_text(f'{code}const int PERIOD = 10000, ROTORS = 0;')
    ran = subprocess.run(
        [compiled(firmware, tmp_path)], input=b'', capture_output=True, check=True
    )
    decoded = [decode_text(line) for line in ran.stdout.splitlines()]
    assert all(frame.checked for frame in decoded)
    hello, *readings = decoded
    assert hello.kind is FrameKind.HELLO
    assert [frame.sequence for frame in readings] == list(range(29))
    assert [frame.time for frame in readings] == list(range(10_000, 300_000, 10_000))
    assert all(frame.values.tolist() == [100, 200, 300, 400] for frame in readings)


def test_the_firmware_sends_and_receives_binary_frames(tmp_path):
    program = compiled(FIRMWARE, tmp_path)
    torques = np.array([0.1, 0.0, 0.05, np.nan])
    command = SerialFrame(FrameKind.TORQUES, 0, 100_000, np.nan_to_num(torques))
    told = encode(command, Protocol.BINARY)
    broken = bytearray(told)
    broken[9] ^= 16
    ran = subprocess.run(
        [program], input=b'noise\0' + told + broken, capture_output=True, check=True
    )
    decoder = FrameDecoder()
    frames = decoder.feed(ran.stdout)
    assert decoder.corrupted == 0
    assert [frame.sequence for frame in frames] == list(range(75))
    assert [frame.time for frame in frames] == list(range(0, 300_000, 4000))
    assert all(frame.values.tolist() == [100, 200, 300, 400] for frame in frames)
    valves = np.array([line.split() for line in ran.stderr.decode().splitlines()], dtype=float)
    opened = valves.any(axis=1)
    assert opened.tolist() == [25 <= number < 50 for number in range(75)]
    np.testing.assert_allclose(valves[30], [255, 0, 127.5, 0])
