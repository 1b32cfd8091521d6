# SPDX-License-Identifier: Apache-2.0
"""Waveforms have the spectrum and the peak of their command, and angles are imposed."""

import math
from typing import Any

import numpy as np
import pytest

from soliton_linkage.actuation import (
    ChainDriver,
    CommandKind,
    DrivenQuantity,
    EdgeCommand,
    EdgeLimits,
    KickReport,
    PneumaticActuator,
    Waveform,
    WaveShape,
    WaveWindow,
)
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain

PERIOD = 0.002
CHAIN = Chain(number_of_rotors=12, spacing=0.1, rotor_length=0.13, rest_angle=1.3)


def command(value: float = 1.0, **fields: Any) -> EdgeCommand:
    times = {name: fields.pop(name, 0.0) for name in ('duration', 'ramp_up', 'ramp_down')}
    waveform = Waveform(**{'frequency': 40.0, 'cycles': 10.0} | fields)
    return EdgeCommand(Edge.FIRST, CommandKind.WAVEFORM, value, **times, waveform=waveform)


def chirp(**fields: Any) -> EdgeCommand:
    return command(shape=WaveShape.CHIRP, cycles=0.0, last_frequency=80.0, duration=5.0, **fields)


def noise(seed: int) -> EdgeCommand:
    band = {'frequency': 30.0, 'last_frequency': 50.0, 'cycles': 0.0}
    return command(0.3, shape=WaveShape.NOISE, seed=seed, duration=20.0, **band)


def spectrum(order: EdgeCommand) -> tuple[Array, Array]:
    """Return angular frequencies and the energy at each of them."""
    values = order.profile.values[:-1]
    step = order.profile.times[1]
    return 2 * math.pi * np.fft.rfftfreq(len(values), step), np.abs(np.fft.rfft(values)) ** 2


def test_a_hann_burst_is_the_sine_under_one_raised_cosine():
    profile = command(2.0, window=WaveWindow.HANN).profile
    times, length = profile.times[:-1], 10 * 2 * math.pi / 40.0
    window = np.sin(math.pi * times / length) ** 2
    np.testing.assert_allclose(profile.values[:-1], 2 * window * np.sin(40 * times), atol=1e-12)
    assert profile.end == pytest.approx(length)
    assert not profile.held


def test_linear_ramps_lie_inside_the_burst():
    order = command(ramp_up=0.3, ramp_down=0.2)
    times = order.profile.times[:-1]
    envelope = np.minimum(np.minimum(times / 0.3, 1), (order.length - times) / 0.2)
    np.testing.assert_allclose(order.profile.values[:-1], envelope * np.sin(40 * times), atol=1e-9)


def test_the_phase_of_a_chirp_has_the_commanded_rate():
    profile = chirp().profile
    zeros = profile.times[1:][np.diff(np.sign(profile.values)) != 0]
    for start, frequency in ((0.0, 40.0), (2.5, 60.0), (4.5, 76.0)):
        (first, *_, last) = zeros[(zeros >= start) & (zeros < start + 0.4)]
        crossings = np.count_nonzero((zeros >= first) & (zeros < last))
        mean = frequency + 8.0 * ((first + last) / 2 - start)
        assert math.pi * crossings / (last - first) == pytest.approx(mean, rel=0.02)


def test_noise_stays_in_its_band_has_its_peak_and_depends_on_its_seed():
    frequencies, energy = spectrum(noise(3))
    inside = (frequencies > 29.5) & (frequencies < 50.5)
    assert energy[inside].sum() > 0.999 * energy.sum()
    assert np.abs(noise(3).profile.values).max() == pytest.approx(0.3)
    np.testing.assert_array_equal(noise(3).profile.values, noise(3).profile.values)
    assert np.abs(noise(3).profile.values - noise(4).profile.values).max() > 0.1


def test_a_table_passes_through_its_samples():
    samples = (0.0, 1.0, -0.5, 0.25)
    order = command(2.0, shape=WaveShape.TABLE, samples=samples, cycles=0.0, duration=0.3)
    for time, sample in zip((0.0, 0.1, 0.2), samples, strict=False):
        assert float(order.profile.after(time)) == pytest.approx(2 * sample, abs=1e-9)


@pytest.mark.parametrize(
    ('fields', 'complaint'),
    [
        ({'cycles': 0.0}, 'cycles of a burst = 0 must be a finite number above 0'),
        ({'frequency': math.nan}, 'frequency of a burst = nan must be a finite number above 0'),
        ({'duration': 1.0}, r'duration = 1 s must be 0 for a waveform with cycles'),
        (
            {'shape': WaveShape.TABLE, 'samples': (0.0, 1.5)},
            'from -1 to 1, not 2 with the largest 1.5',
        ),
        (
            {'shape': WaveShape.NOISE, 'last_frequency': 1.0},
            'must not exceed last_frequency = 1 rad/s',
        ),
        ({'ramp_up': 9.0}, r'ramps of 9 s must not be longer than the whole waveform, 1.57'),
        ({'cycles': 1e7}, 'the limit is 200000; shorten it or lower its frequency'),
    ],
)
def test_impossible_waveforms_are_rejected(fields, complaint):
    with pytest.raises(ValueError, match=complaint):
        assert command(**fields).profile


def test_an_imposed_angle_is_at_most_half_a_turn():
    limits = EdgeLimits(100.0, 0.1)
    command(3.0, quantity=DrivenQuantity.ANGLE).check(limits, PneumaticActuator())
    with pytest.raises(ValueError, match=r'angle = 4 rad must lie in the range -3.14'):
        command(4.0, quantity=DrivenQuantity.ANGLE).check(limits, PneumaticActuator())


def driven(
    order: EdgeCommand, rotor: int, limit: float, period: float = PERIOD
) -> tuple[Array, ElasticSimulation, list[KickReport]]:
    """Return the angles of a chain in closed loop, (T, N); torques act one frame later."""
    reports: list[KickReport] = []
    driver = ChainDriver(CHAIN, PneumaticActuator(), 0.5, 0.2, reports.append)
    simulation = ElasticSimulation(CHAIN, CHAIN.uniform_state(-1), period=period)
    driver.play('edge_command', order, rotor, limit)
    angles, sent = [simulation.angles], [np.zeros(CHAIN.number_of_rotors)] * 2
    for frame in range(1, math.ceil(order.length / period) + 6):
        simulation.hold(sent[-2])
        simulation.advance()
        angles.append(simulation.angles)
        before, stamp = (round(1e9 * period * each) for each in (frame - 1, frame))
        torques = driver.frame(before, stamp, simulation.angles)
        sent.append(0 * sent[0] if torques is None else torques)
    return np.array(angles), simulation, reports


@pytest.mark.parametrize(
    ('rotor', 'period', 'bound'), [(0, 0.001, 0.002), (5, PERIOD, 0.005), (0, 0.004, 0.05)]
)
def test_a_rotor_follows_an_imposed_angle(rotor, period, bound):
    order = command(0.3, quantity=DrivenQuantity.ANGLE, window=WaveWindow.HANN)
    angles, _, _ = driven(order, rotor, math.inf, period)
    # The command starts with frame 1 and acts from frame 2 on.
    delayed = period * (np.arange(len(angles)) - 2)
    wanted = np.interp(delayed, order.profile.times, order.profile.values)
    error = angles[:, rotor] - angles[0, rotor] - wanted
    assert np.abs(error[delayed < order.length - period]).max() < bound * 0.3


def test_a_torque_beyond_the_limit_is_cut_and_reported():
    order = command(0.3, quantity=DrivenQuantity.ANGLE, window=WaveWindow.HANN)
    _, _, (report,) = driven(order, 0, 1e-3)
    assert report.saturated
    assert report.peak_torque == pytest.approx(1e-3)


def test_the_report_of_a_torque_waveform_has_its_impulse_and_its_work():
    order = command(2e-3, ramp_up=0.1, ramp_down=0.1, cycles=10.25)
    _, simulation, (report,) = driven(order, 0, 0.1)
    expected = float(order.profile.integral(0.0, order.length))
    assert report.impulse[0] == pytest.approx(expected, rel=1e-6)
    assert not report.impulse[1:].any()
    assert report.work == pytest.approx(simulation.energy, rel=1e-6)
    assert report.duration == pytest.approx(order.length, abs=2 * PERIOD)
    assert not report.saturated
    assert not report.cut_short


def test_another_edge_command_replaces_a_waveform():
    reports: list[KickReport] = []
    driver = ChainDriver(CHAIN, PneumaticActuator(), 0.5, 0.2, reports.append)
    driver.play('edge_command', command(0.01), 3, 0.1)
    angles = CHAIN.uniform_state(-1)
    driver.frame(0, 2_000_000, angles)
    driver.command('edge_command', EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 0.0), Edge.FIRST)
    torques = driver.frame(2_000_000, 4_000_000, angles)
    assert torques is not None
    assert not torques.any()
    for frame in (3, 4):
        driver.frame(2_000_000 * (frame - 1), 2_000_000 * frame, angles)
    (report,) = reports
    assert report.cut_short
