# SPDX-License-Identifier: Apache-2.0
"""Simulate a rig for serial_encoders: a chain, and a microcontroller with encoders and valves.

The pressure of a valve exerts a torque on its rotor. The program opens a pseudo-terminal and
prints its path, which serial_encoders uses as its serial port. Until Ctrl-C, the simulated
controller sends the angles of the rotors, and applies the torques and pressures that it receives.
At the start, the chain is at rest without a soliton, and all rotors lean towards rotor 0.
"""

from __future__ import annotations

import contextlib
import os
import pty
import sys
import time
import tty
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from soliton_linkage.command_line import PlainParser
from soliton_linkage.dynamics.world import World, WorldParameters
from soliton_linkage.linkage.feedback import NO_FEEDBACK
from soliton_linkage.linkage.gravity import NO_GRAVITY
from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage.microcontroller.rotary_encoders import RotaryEncoders
from soliton_linkage.microcontroller.simulated_controller import (
    ControllerSettings,
    SimulatedController,
)
from soliton_linkage_nodes.messages.chain_source import chain_of_file
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.programs.command_line import add_quantity, exit_on_failure
from soliton_linkage_nodes.runtime.process import interrupt_on_signals

_RATE = Quantity('frames per second', 'Hz', 1.0, 1000.0)
"""Frame rate, at most 1000 Hz. At 1000 Hz, 40 rotors would need a serial port with 1.8 Mbaud."""
_COUNTS = Quantity('counts of an encoder per turn', '', 2, 65536)
"""Resolution of an encoder, at most 16 bits."""

_TOLERANCE = 1e-6
"""Error tolerance of the solver in each step [rad], a hundredth of a count of a 16-bit encoder."""
_REPORTED_DELAY = 1.0
"""If the simulation lags behind the clock by more than this, the program warns [s]."""
_MOST_BYTES = 2**16
"""Largest number of bytes that one call reads [1], more than the buffer of the system holds."""


class PseudoTerminal:
    """Pseudo-terminal whose other end a client can open as a serial port."""

    def __init__(self, link: Path | None = None) -> None:
        """Open a pseudo-terminal; `link` is the path of a symbolic link to the client's end."""
        self._here, self._there = pty.openpty()
        tty.setraw(self._there)
        os.set_blocking(self._here, False)
        self._link = link
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(os.ttyname(self._there))

    @property
    def path(self) -> str:
        """Path that a client opens as a serial port: `link`, or the device without a link."""
        return str(self._link or os.ttyname(self._there))

    def read(self) -> bytes:
        """Return the bytes that the client has sent since the last call."""
        try:
            return os.read(self._here, _MOST_BYTES)
        except BlockingIOError:
            return b''

    def write(self, data: bytes) -> None:
        """Send bytes to the client; they are lost while the buffer is full."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._here, data)

    def close(self) -> None:
        """Close both ends and remove the symbolic link, if any."""
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._here)
        os.close(self._there)


class RealTimeChain:
    """Simulated chain and controller that communicate with a client through a pseudo-terminal."""

    def __init__(
        self,
        named: NamedChain,
        controller: SimulatedController,
        terminal: PseudoTerminal,
        rate: float,
    ) -> None:
        """Start with the chain at rest; `rate` is the frame rate [Hz].

        The feedback gains of the chain are ignored, because this controller applies only received
        commands.
        """
        chain = replace(named.chain, feedback=NO_FEEDBACK)
        world = World(chain, named.joint_names, WorldParameters(tolerance=_TOLERANCE), 1 / rate)
        self._simulation = world.begin(world.initial_state(), NO_GRAVITY)
        self._controller, self._terminal = controller, terminal
        self._terminal.write(controller.start(0.0))

    @property
    def time(self) -> float:
        """Simulated time of the next frame [s]."""
        return self._simulation.time

    def play(self) -> None:
        """Apply received commands, send the angles, and simulate until the next frame."""
        simulation = self._simulation
        self._controller.receive(simulation.time, self._terminal.read())
        simulation.hold(self._controller.torques(simulation.time))
        self._terminal.write(self._controller.measure(simulation.time, simulation.angles))
        simulation.advance()


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate until Ctrl-C; exit with 1 after a failure, 130 after Ctrl-C."""
    parser = PlainParser(prog='simulated_controller', description=__doc__)
    parser.add_argument('chain', type=Path, help='parameter file, such as config/flipper.yaml')
    parser.add_argument(
        '--protocol', choices=('binary', 'text'), default='binary', help='serial protocol (binary)'
    )
    add_quantity(parser, '--rate', _RATE, 250.0)
    add_quantity(parser, '--drift', described_fields(ControllerSettings)['drift'], 0.0)
    add_quantity(parser, '--counts-per-turn', _COUNTS, 4096.0, metavar='COUNTS')
    parser.add_argument(
        '--link', type=Path, metavar='PATH', help='path of a symbolic link to the port'
    )
    options = parser.parse(arguments)
    with exit_on_failure('simulated_controller'):
        interrupt_on_signals()
        named = chain_of_file(options.chain)
        encoders = RotaryEncoders((options.counts_per_turn,), offsets=named.encoder_offsets)
        settings = ControllerSettings(options.protocol, options.drift)
        controller = SimulatedController(named.rotors, encoders, settings)
        terminal = PseudoTerminal(options.link)
        try:
            played = RealTimeChain(named, controller, terminal, options.rate)
            print(
                f'{terminal.path}\nserial_encoders --ros-args --params-file {options.chain} '
                f'-p chain_from:=parameters -p port:={terminal.path}',
                flush=True,
            )
            _run_in_real_time(played)
        finally:
            terminal.close()


def _run_in_real_time(played: RealTimeChain) -> None:
    begun, reported = time.monotonic(), False
    while True:
        early = begun + played.time - time.monotonic()
        time.sleep(max(early, 0.0))
        played.play()
        if early < -_REPORTED_DELAY and not reported:
            reported = True
            print(
                f'simulated_controller: {-early:.2g} s behind the clock, because this machine is '
                'too slow; lower --rate or use a shorter chain',
                file=sys.stderr,
            )
