# SPDX-License-Identifier: Apache-2.0
"""Wave packets move at the group velocity, and act on walls in the band only."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from study_files import results

from soliton_linkage.estimation import Analyser
from soliton_linkage.estimation.estimates import TrackingStatus
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage_studies.accuracy.walls import nearest_arc
from soliton_linkage_studies.experiments import energy_per_rotor
from soliton_linkage_studies.waves import program
from soliton_linkage_studies.waves.program import (
    Burst,
    WaveTask,
    group_velocity,
    packet_velocity,
    spectrum,
)

CONFIG = Path(__file__).parents[2] / 'config/studies/waves.yaml'
SPINNER = Chain(60, rotor_length=0.13, rest_angle=1.3)


def test_a_burst_delivers_no_net_impulse_and_has_its_amplitude():
    burst, inertia = Burst(30.0, 10.0, 0.1), 2e-4
    times = np.linspace(0.0, burst.duration, 100_001)
    torques = np.array([burst.torque(inertia, float(time)) for time in times])
    assert (
        abs(np.sum(torques) * (times[1] - times[0]))
        < 1e-9 * np.abs(torques).max() * burst.duration
    )
    assert np.abs(torques).max() == pytest.approx(inertia * 30.0**2 * 0.1, rel=0.01)
    assert burst.torque(inertia, burst.duration * 1.01) == 0


@pytest.mark.parametrize('frequency', [30.0, 39.0, 46.0])
def test_a_small_packet_moves_at_the_group_velocity(frequency):
    run = WaveTask(SPINNER, Burst(frequency, 12.0, 0.005), 4.0)()
    velocity = packet_velocity(SPINNER, run.recording, 30)
    assert velocity == pytest.approx(group_velocity(SPINNER, frequency), rel=0.05)
    recording = run.recording
    energies = energy_per_rotor(SPINNER, recording.angles, recording.rates).sum(axis=1)
    total = SPINNER.elastic_energy(recording.angles) + SPINNER.kinetic_energy(recording.rates)
    np.testing.assert_allclose(energies, total, rtol=1e-12, atol=1e-20)


def test_packets_of_the_band_pull_the_kink_and_others_do_not():
    low, high = band_edges(SPINNER)
    moved = {
        frequency: WaveTask(SPINNER, Burst(frequency, 20.0, 0.1), 6.0, 30.0)().displacement
        for frequency in (0.6 * low, 39.0, 1.3 * high)
    }
    inside = moved.pop(39.0)
    assert inside < -1
    assert max(map(abs, moved.values())) < 1e-2


def test_the_analyser_places_a_kink_in_a_wave_packet_as_stated():
    random, noise = np.random.default_rng(1), 0.01
    run = WaveTask(SPINNER, Burst(33.5, 60.0, 0.05), 12.0, 20.3, frames=3000)()
    analyser, orbit = Analyser(SPINNER), orbit_of(SPINNER)
    arc, scores = orbit.arc_at(20.3, 0), []
    for time, angles in zip(run.recording.times, run.recording.angles, strict=True):
        arc = nearest_arc(orbit, angles, arc)
        noisy = angles + noise * random.standard_normal(len(angles))
        analysis = analyser.analyse(round(1e9 * time), noisy)
        if analysis.status is TrackingStatus.TRACKING:
            (wall,) = analysis.solitons
            error = wall.position - orbit.site(arc) * SPINNER.spacing
            scores.append(error / wall.position_deviation)
    assert len(scores) > 0.95 * len(run.recording.times)
    assert np.mean(np.abs(scores) > 3) < 0.01
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.2


def test_a_kink_has_a_zero_mode_local_modes_and_no_barrier_at_any_site():
    low, high = band_edges(SPINNER)
    frequencies = []
    for site in np.linspace(29.0, 31.0, 9):
        found = spectrum(SPINNER, float(site))
        assert found.energy < 1e-28
        assert found.frequencies[0] < 1e-3
        local = found.frequencies > 1.02 * high
        assert local.any()
        assert found.participations[local].max() < 10
        assert not ((found.frequencies > 1) & (found.frequencies < 0.98 * low)).any()
        frequencies.append(found.frequencies[-1])
    assert frequencies[0] == pytest.approx(frequencies[-1], rel=1e-6)
    assert np.ptp(frequencies) > 5


def test_the_program_writes_page_table_and_data(tmp_path):
    settings = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    settings['duration'] = 2.0
    settings['kink'] = {'frequencies': [10.0, 39.0], 'amplitudes': [0.1], 'cycles': [5.0]}
    settings['uniform'] = {'frequencies': [30.0, 39.0], 'amplitudes': [0.1, 1.0]}
    rows = results(program.main, 'waves', settings, tmp_path)
    assert {row['panel'] for row in rows} == set('abcdef')
