# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns: the bits of the core, dispersions that act, statistics, files that survive."""

import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from typer.testing import CliRunner

from rpo_core import metrics
from rpo_core.closed_loop import fly as fly_core
from rpo_core.validation import InputError
from rpo_training.campaign import config, fleet, flying, noise, sampling, single, statistics
from rpo_training.campaign.store import Store
from rpo_training.cli import app

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / 'offline_training' / 'campaigns' / 'paper_test.yaml'
SHORT = """
schema: rpo/scenario/1
name: short
orbit_radius_m: 6678000.0
mass_kg: 10.0
max_force_n: 0.5
dt_s: 0.1
duration_s: 20.0
initial_position_m: [10.0, 60.0, -40.0]
initial_velocity_m_s: [0.0, 0.0, 0.0]
epoch: 2026-01-01T00:00:00Z
disturbance: paper_phase
"""
EVERYTHING = {
    'initial_position_m': {'uniform': [5.0, 4.0, 3.0]},
    'initial_velocity_m_s': {'normal': 0.02},
    'mass_share': {'normal': 0.03},
    'thrust_share': {'normal': 0.02},
    'misalignment_deg': {'normal': 1.0},
    'navigation_position_bias_m': {'normal': 0.02},
    'navigation_velocity_bias_m_s': {'normal': 0.0005},
    'navigation_position_noise_m': {'white': 0.01},
    'navigation_velocity_noise_m_s': {'white': 0.001},
    'delay_ticks': {'whole': 3},
    'disturbance_amplitude_share': {'uniform': 0.5},
    'disturbance_phase_rad': {'uniform': 3.0},
    'disturbance_frequency_share': {'uniform': 0.5},
    'orbit_altitude_m': {'uniform': 100e3},
}


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a campaign of a short flight and returns its path."""
    scenario = tmp_path / 'short.yaml'
    scenario.write_text(SHORT)

    def make(**changes):
        document = {
            'schema': config.SCHEMA,
            'name': 'test',
            'scenario': str(scenario),
            'controller': 'handmade',
            'runs': 90,
            'seed': 3,
            'dispersions': EVERYTHING,
            'success': {'late_position_m': 60.0},
            **changes,
        }
        path = tmp_path / 'c.yaml'
        path.write_text(yaml.safe_dump({k: v for k, v in document.items() if v is not None}))
        return path

    return make


def all_columns(campaign):
    results = [fleet.fly_unit(campaign, u) for u in range(fleet.units(campaign.config.runs))]
    return dict(zip(fleet.COLUMNS, np.hstack(results), strict=True))


# Noise.


@pytest.mark.parametrize(
    ('counter', 'key', 'words'),
    [  # the known answers that come with Random123
        ((0,) * 4, (0,) * 2, '6627e8d5 e169c58d bc57ac4c 9b00dbd8'),
        ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, '408f276d 41c83b0e a20bc7c6 6d5451fd'),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            'd16cfe09 94fdcceb 5001e420 24126ea1',
        ),
    ],
)
def test_philox_gives_the_known_answers(counter, key, words):
    for function in (noise.philox, getattr(noise.philox, 'py_func', noise.philox)):
        assert ' '.join(f'{w:08x}' for w in function(*counter, *key)) == words


@settings(max_examples=300)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_a_pair_of_normals_is_that_of_box_and_muller(a, b):
    radius = np.sqrt(-2.0 * np.log((a + 0.5) / 2**32))
    angle = 2.0 * np.pi * (b + 0.5) / 2**32 - np.pi / 4.0
    # The quarter of the circle comes from the first bits; the angle from its middle.
    expected = radius * np.sin(angle), radius * np.cos(angle)
    assert noise.normal_pair(a, b) == pytest.approx(expected, abs=1e-11)
    interpreted = getattr(noise.normal_pair, 'py_func', noise.normal_pair)
    assert interpreted(a, b) == noise.normal_pair(a, b)


def test_noise_is_normal_white_and_independent():
    sample = np.array([noise.six_normals(t, 7, k) for k in range(4) for t in range(2000)])
    assert stats.kstest(sample.ravel(), 'norm').pvalue > 1e-3
    correlation = np.corrcoef(np.hstack([sample[:-1], sample[1:]]).T) - np.eye(12)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(len(sample))


# Bits.


def test_every_run_has_the_bits_and_figures_of_the_core(write):
    campaign = config.load(write())
    columns = all_columns(campaign)
    for number in (0, 1, 39, 40, 89):
        flight = single.fly_run(campaign, number)
        final = [columns[name][number] for name in fleet.FINAL]
        np.testing.assert_array_equal(final, flight.states[-1])
        figures, late = metrics.assess(flight), metrics.window(flight, metrics.CLAIM_WINDOW_S)
        delay = int(columns['delay_ticks'][number])
        expected = {
            'energy_n2s': figures.energy_n2s,
            'arrival_speed_m_s': figures.arrival_speed_m_s,
            'arrival_distance_m': figures.arrival_distance_m,
            'slew_n_s': metrics.slew_n_s(flight.applied_forces_n[delay:], 0.1),
            'late_position_m': late.position_m,
            'late_velocity_m_s': late.velocity_m_s,
            'late_force_n': late.force_n,
            'delta_v_m_s': np.abs(flight.applied_forces_n).sum() * 0.1 / columns['mass_kg'][number],
        }
        for name, value in expected.items():
            assert columns[name][number] == pytest.approx(value, rel=1e-12), name


def test_without_dispersions_it_is_the_flight_of_the_core(write):
    campaign = config.load(write(dispersions={}))
    flight = fly_core(campaign.scenario, campaign.controller)
    for run in (single.fly_run(campaign, 5), single.fly_run(campaign, 70)):
        np.testing.assert_array_equal(run.states, flight.states)
        np.testing.assert_array_equal(run.forces_n[:-1], flight.forces_n[:-1])
    final = [all_columns(campaign)[name][11] for name in fleet.FINAL]
    np.testing.assert_array_equal(final, flight.states[-1])


def test_a_run_does_not_depend_on_what_flies_beside_it(write):
    campaign = config.load(write())
    columns = all_columns(campaign)
    for first, count in ((17, 1), (17, 2), (3, 45)):
        some = fleet.fly_runs(campaign, first, count)
        for name in fleet.COLUMNS:
            np.testing.assert_array_equal(some[name], columns[name][first : first + count])


def test_interpreted_and_compiled_fly_the_same_bits(write, tmp_path):
    blink = tmp_path / 'blink.yaml'
    blink.write_text(SHORT.replace('duration_s: 20.0', 'duration_s: 1.0'))
    path = write(scenario=str(blink), runs=3)
    code = (
        'import hashlib, sys\n'
        'from rpo_training.campaign import config, fleet\n'
        'results = fleet.fly_unit(config.load(sys.argv[1]), 0)\n'
        'print(hashlib.sha256(results.tobytes()).hexdigest())\n'
    )
    command = [sys.executable, '-W', 'error', '-c', code, str(path)]
    digests = {
        subprocess.check_output(command, env={**os.environ, 'RPO_JIT': choice})
        for choice in ('0', '1')
    }
    assert len(digests) == 1


# Dispersions.


@pytest.mark.parametrize('name', EVERYTHING)
@pytest.mark.parametrize('sampling_name', config.SAMPLINGS)
def test_every_dispersion_changes_the_flight(write, name, sampling_name):
    one = {'dispersions': {name: EVERYTHING[name]}, 'runs': 20, 'sampling': sampling_name}
    dispersed = all_columns(config.load(write(**one)))
    nominal = all_columns(config.load(write(dispersions={}, runs=20)))
    moved = dispersed['final_x_m'] != nominal['final_x_m']
    if name == 'delay_ticks':  # nothing happens to a run without delay
        np.testing.assert_array_equal(moved, dispersed['delay_ticks'] > 0)
        assert moved.any()
    else:
        assert moved.all()
        assert len(np.unique(dispersed['final_x_m'])) == 20


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize(
    'name', [name for name, kind in config.KINDS.items() if kind.components == 3]
)
def test_every_component_acts(write, name, axis):
    spread = [0.0, 0.0, 0.0]
    spread[axis] = 0.01
    one = all_columns(config.load(write(dispersions={name: {'uniform': spread}}, runs=8)))
    none = all_columns(config.load(write(dispersions={}, runs=8)))
    assert any((one[final] != none[final]).all() for final in fleet.FINAL)


def test_the_effects_are_those_of_physics(write):
    campaign = config.load(write())
    runs = sampling.draw(campaign, 0, 90)
    for i in range(5):
        matrix = sampling.rotation(runs.parameters[i, 10:13])
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(matrix @ runs.parameters[i, 10:13], runs.parameters[i, 10:13])
    quarter = sampling.rotation(np.array([0.0, 0.0, np.pi / 2]))  # about z: x goes to y
    np.testing.assert_allclose(quarter @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)
    forward = sampling.Runs(runs.numbers, runs.parameters.copy(), runs.keys)
    forward.parameters[0, 7:13] = [0.1, 0.0, 0.0, 0.0, 0.0, np.pi / 2]
    np.testing.assert_allclose(forward.thrust(0) @ [1.0, 0.0, 0.0], [0.0, 1.1, 0.0], atol=1e-15)
    assert runs.step(0, 0.1).vxfx == pytest.approx(0.1 / runs.masses_kg[0], rel=1e-5)


def test_draws_have_the_distributions_that_were_asked_for(write):
    campaign = config.load(write(runs=2000))
    p = dict(zip(sampling.PARAMETERS, sampling.draw(campaign, 0, 2000).parameters.T, strict=True))
    scenario = campaign.scenario
    x = (p['initial_x_m'] - scenario.initial_position_m[0]) / 5.0
    assert stats.kstest(x, 'uniform', (-1.0, 2.0)).pvalue > 0.01
    mass = (p['mass_kg'] / scenario.mass_kg - 1.0) / 0.03
    assert stats.kstest(mass, stats.truncnorm(-3.0, 3.0).cdf).pvalue > 0.01
    assert np.abs(mass).max() <= 3.0
    assert np.bincount(p['delay_ticks'].astype(int)).tolist() == [500] * 4  # a stratified choice
    # Every block of 1000 is a Latin hypercube: one value in each of 1000 strata.
    for block in (x[:1000], x[1000:]):
        strata = np.floor((block + 1.0) / 2.0 * 1000.0)
        assert sorted(strata) == list(range(1000))


def test_another_dispersion_leaves_the_draws_of_the_others_alone(write):
    some = {name: EVERYTHING[name] for name in ('mass_share', 'orbit_altitude_m')}
    few = sampling.draw(config.load(write(dispersions=some)), 30, 10).parameters
    many = sampling.draw(config.load(write()), 30, 10).parameters
    for name in ('mass_kg', 'orbit_radius_m'):
        column = sampling.PARAMETERS.index(name)
        np.testing.assert_array_equal(few[:, column], many[:, column])


# Statistics.


def test_wilsons_interval_is_the_closed_form():
    z, n, k = 1.959963984540054, 10000, 9945
    share = k / n
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    found = statistics.rate('success', k, n)
    assert (found.low, found.high) == pytest.approx((centre - half, centre + half), rel=1e-12)


def test_a_figure_that_is_not_a_number_is_no_success(write):
    settings = config.load(write()).config
    kept = statistics.successes(settings, {'late_position_m': np.array([1.0, np.nan, 61.0])})
    assert kept.tolist() == [True, False, False]


# Files.


def test_the_folder_is_the_same_on_any_threads_interrupted_or_not(write, tmp_path):
    campaign = config.load(write(runs=1250))
    for name, workers in (('one', 1), ('two', 2)):
        flying.fly(Store.create(tmp_path / name, campaign), workers)

    class Interrupt(Exception):
        pass

    def stop(runs, successful):
        raise Interrupt

    store = Store.create(tmp_path / 'three', campaign)
    with pytest.raises(Interrupt):
        flying.fly(store, 2, progress=stop)
    assert 0 < len(store.pending()) < 7
    flying.fly(Store.open(tmp_path / 'three'), 1)
    for name in ('results.npz', 'summary.yaml', 'campaign.yaml'):
        contents = {(tmp_path / run / name).read_bytes() for run in ('one', 'two', 'three')}
        assert len(contents) == 1, name
    with np.load(tmp_path / 'one' / 'results.npz') as results:
        assert set(results.files) == set(fleet.COLUMNS)
        assert results['mass_kg'].shape == (1250,)
    assert not list((tmp_path / 'one').glob('*.part'))


def test_a_killed_campaign_goes_on(write, tmp_path):
    folder = tmp_path / 'killed'
    path = write(runs=20000)
    command = [sys.executable, '-c', 'from rpo_training.cli import app; app()', 'campaign']
    process = subprocess.Popen([*command, str(path), '-o', str(folder)], stderr=subprocess.PIPE)
    deadline = time.monotonic() + 40.0
    while time.monotonic() < deadline:
        done = folder / 'done.part'
        if done.is_file() and (folder / 'campaign.yaml').is_file() and any(done.read_bytes()):
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL, 'it had ended before'
    assert 0 < len(Store.open(folder).pending()) < 100
    flying.fly(Store.open(folder))
    expected = fleet.fly_runs(config.load(path), 19990, 10)
    for name in fleet.COLUMNS:
        np.testing.assert_array_equal(Store.open(folder).column(name)[-10:], expected[name])


def test_ctrl_c_stops_cleanly_and_says_how_to_go_on(write, tmp_path):
    folder = tmp_path / 'stopped'
    command = [sys.executable, '-c', 'from rpo_training.cli import app; app()', 'campaign']
    process = subprocess.Popen(
        [*command, str(write(runs=1000000)), '-o', str(folder)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'COLUMNS': '200'},
    )
    deadline = time.monotonic() + 40.0
    while time.monotonic() < deadline:
        done = folder / 'done.part'
        if done.is_file() and any(done.read_bytes()):
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    assert 'Traceback' not in errors
    assert f'rpo campaign --resume {folder}' in errors


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_memory_is_flat(tmp_path, write):
    """A million runs need no more than ten thousand, but for columns of 8 MB at the end."""
    scenario = tmp_path / 'blink.yaml'
    scenario.write_text(SHORT.replace('duration_s: 20.0', 'duration_s: 0.1'))
    code = (
        'import resource, sys\n'
        'from pathlib import Path\n'
        'from rpo_training.campaign import config, flying\n'
        'from rpo_training.campaign.store import Store\n'
        'campaign = config.load(sys.argv[1], runs=int(sys.argv[2]))\n'
        'flying.fly(Store.create(Path(sys.argv[3]), campaign), 2)\n'
        'print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)\n'
    )
    path = write(scenario=str(scenario))
    peaks = []
    for runs in (10_000, 1_000_000):
        command = [sys.executable, '-c', code, str(path), str(runs), str(tmp_path / str(runs))]
        peaks.append(int(subprocess.check_output(command)))
    assert peaks[1] - peaks[0] < 64 * 1024  # KiB; all columns are 312 MB


# Bad input.


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'schema': 'rpo/campaign/2'}, '`schema` must be rpo/campaign/1'),
        ({'dispersions': {'mas_share': {'normal': 0.1}}}, 'did you mean `mass_share`'),
        ({'dispersions': {'mass_share': {'normal': -0.1}}}, 'must be a finite number >= 0'),
        ({'dispersions': {'mass_share': {'gauss': 0.1}}}, '`dispersions.mass_share.gauss`'),
        ({'dispersions': {'mass_share': {'uniform': 0.1, 'normal': 0.1}}}, 'must give one of'),
        ({'dispersions': {'mass_share': {}}}, 'must give one of'),
        ({'dispersions': {'mass_share': {'uniform': 1.2}}}, '<= 0.99'),
        ({'dispersions': {'thrust_share': {'normal': [0.1, 0.1]}}}, 'or a list of 3'),
        ({'dispersions': {'delay_ticks': {'whole': 1.5}}}, 'must be a whole number'),
        ({'dispersions': {'orbit_altitude_m': {'uniform': 4e5}}}, '`orbit_radius_m` must be'),
        ({'success': {}}, '`success` must limit at least one of'),
        ({'success': {'late_positon_m': 1.0}}, 'did you mean `late_position_m`'),
        ({'success': {'late_position_m': -1.0}}, '`success.late_position_m` must be'),
        ({'runs': 0}, '`runs` must be a whole number >= 1'),
        ({'sampling': 'sobol'}, '`sampling` must be one of latin_hypercube, random'),
        ({'controller': 'nobody'}, '`controller` must be one of'),
        ({'scenario': 'paper_training'}, 'must be a single flight'),
        ({'name': 'a/b'}, '`name` must be letters'),
        (
            {'scenario': 'approach', 'dispersions': {'disturbance_phase_rad': {'uniform': 1.0}}},
            'has no effect: scenario approach has no such disturbance',
        ),
    ],
)
def test_bad_configurations_are_one_sentence(write, changes, said):
    result = CliRunner().invoke(app, ['campaign', str(write(**changes))], env={'COLUMNS': '300'})
    assert result.exit_code == 2
    assert said in result.output
    assert result.output.count('\n') == 1


def test_a_folder_of_another_campaign_is_left_alone(write, tmp_path):
    folder = tmp_path / 'f'
    campaign = config.load(write())
    Store.create(folder, campaign)
    with pytest.raises(InputError, match='of this campaign: go on with --resume'):
        Store.create(folder, campaign)
    with pytest.raises(InputError, match='of another configuration'):
        Store.create(folder, config.load(write(), seed=4))
    (tmp_path / 'g').mkdir()
    (tmp_path / 'g' / 'letter.txt').touch()
    with pytest.raises(InputError, match='it holds other things'):
        Store.create(tmp_path / 'g', campaign)
    with pytest.raises(InputError, match='must be the folder of a campaign'):
        Store.open(tmp_path / 'g')
    with (
        Store.open(folder).alone(),
        pytest.raises(InputError, match='another process flies this campaign'),
    ):
        flying.fly(Store.open(folder))
    with (folder / 'done.part').open('ab') as file:
        file.write(b'\1')
    with pytest.raises(InputError, match='results are damaged'):
        Store.open(folder).pending()


def test_a_disk_that_is_too_small_says_so_at_once(write, tmp_path):
    campaign = config.load(write(runs=1_000_000))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    try:
        with pytest.raises(InputError, match=r'results.part: cannot reserve 312000000 bytes'):
            Store.create(tmp_path / 'f', campaign)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    Store.create(tmp_path / 'f', config.load(write()))  # nothing is in the way


def test_the_command_flies_repeats_and_refuses(write, tmp_path):
    run = CliRunner().invoke
    path, folder = str(write()), str(tmp_path / 'out')
    flown = run(app, ['campaign', path, '-o', folder])
    assert flown.exit_code == 0, flown.output
    assert ' / 90 ' in flown.output
    again = run(app, ['campaign', folder, '--run', '7', '--csv', str(tmp_path / 'run.csv')])
    assert again.exit_code == 0, again.output
    assert 'The bits are those of the core and of the campaign.' in again.output
    table = np.loadtxt(tmp_path / 'run.csv', delimiter=',', skiprows=1)
    np.testing.assert_array_equal(
        table[-1, 1:7], [Store.open(Path(folder)).column(name)[7] for name in fleet.FINAL]
    )
    for arguments, said in (
        ([path, '--run', '90'], '`--run` must be at most 89'),
        ([folder, '--seed', '2'], '`--seed` cannot change'),
        ([path, '-o', folder], 'holds a campaign already'),
        ([], 'is needed'),
        ([path, '--csv', 'x.csv'], 'give --run too'),
    ):
        refused = run(app, ['campaign', *arguments], env={'COLUMNS': '300'})
        assert (refused.exit_code, said in refused.output) == (2, True), refused.output


def test_the_shipped_campaign_is_valid():
    campaign = config.load(SHIPPED)
    assert set(campaign.config.dispersions) == set(config.KINDS)  # shows every one
    again = config.Campaign.of_texts(campaign.texts, ('a', 'b', 'c'))
    assert again.config == campaign.config
    assert replace(again.config, seed=2) != campaign.config
