# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns in true worlds, with message faults: their bits; dispersions act."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from campaign_documents import EVERYTHING
from invoking import invoke
from kept import assert_kept, digits
from scipy import stats

from rpo.montecarlo import config, faults, run_batch
from rpo.montecarlo.quantities import QUANTITIES
from rpo.montecarlo.run_batch import fly_runs
from rpo.montecarlo.sampling import draw
from rpo_core.assurance.shaping import Shaping
from rpo_core.attitude.chaser import Chaser, Wheels
from rpo_core.control.attitude import AttitudeControl
from rpo_core.control.attitude_limits import AttitudeLimits
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.scenario.requirements import Requirements
from rpo_core.thrusters.table import Failure, ThrusterTable
from rpo_core.thrusters.thrusters import Propellant, Pulses, Thrusters
from rpo_core.wire.interfaces import CONTROL_FORCE, DISTURBANCE_FORCE
from rpo_sim.plant import FreeRunningPlant

WORLD = {
    **{
        name: spread
        for name, spread in EVERYTHING.items()
        if 'disturbance' not in name and 'navigation' not in name
    },
    'density_share': {'uniform': 0.5},
    'ballistic_coefficient_share': {'normal': 0.1},
    'true_anomaly_deg': {'uniform': 180.0},
    'stuck_off_thruster': {'whole': 11},
    'sensor_noise_share': {'uniform': 0.3},
    'sensor_scale_error': {'normal': 0.002},
    'sensor_bias_x_m': {'normal': 0.02},
}
LEO = replace(scenario.load_scenario('world_leo'), duration_s=12.0)
PLAIN = replace(scenario.load_scenario('approach'), duration_s=12.0)
FIRING = Thrusters(
    pulses=Pulses(count=6, modulation='pulse_width', minimum_on_time_s=0.01),
    propellant=Propellant(specific_impulse_s=2.0, mass_kg=1.0),
)
SOME = {'initial_position_m': {'uniform': 5.0}, 'mass_share': {'normal': 0.03}}
STEERED = Chaser(
    inertia_kg_m2=((10.0, 0.5, 0.0), (0.5, 14.0, 0.3), (0.0, 0.3, 20.0)),
    attitude=(0.5, 0.5, 0.1, 0.7),
    wheels=Wheels(torque_nm=2.0, momentum_nms=10.0),
)


def shipped(name, *sections):
    """Return the first 12 s of a shipped campaign, with other sections, and its dispersions."""
    campaign = config.load(name, controller='handmade')
    flown = replace(campaign.scenario, duration_s=12.0).equipped(*sections)
    drawn = campaign.config.dispersions.items()
    spreads = {name: list(d.spread) if len(d.spread) > 1 else d.spread[0] for name, d in drawn}
    return flown, {name: {d.distribution: spreads[name]} for name, d in drawn}


CASES = {
    'leo': (LEO, WORLD),
    'measured and shaped': shipped('paper_test_measured', Shaping(0.05, 0.001)),
    'tumbling_docking': shipped('tumbling_docking'),
}


def flown_lines(loaded):
    """Yield case, controller, and where its second run ends, with its energy."""
    for case, controller in [*((case, 'handmade') for case in CASES), ('leo', 'pd')]:
        flown, dispersions = CASES[case]
        contact = flown.requirements is not None and flown.requirements.contact_range_m
        judged = {'success': None} if contact else {}
        campaign = loaded(flown, dispersions=dispersions, controller=controller, **judged)
        columns = fly_runs(campaign, 1, 1)
        said = digits(columns[name][0] for name in (*run_batch.FINAL, 'energy_n2s'))
        yield f'{case}, {controller}: {said}'


def test_runs_in_every_world_end_as_the_list_says(loaded):
    assert_kept(Path(__file__).with_name('expected') / 'worlds.txt', flown_lines(loaded))


def drawn_lines(loaded):
    """Yield quantities, then the lines that each changes in the file of a run's scenario."""
    for name, quantity in QUANTITIES.items():
        needed = '' if quantity.need is None else f' of {quantity.need.what}'
        ways = '/'.join(quantity.distributions)
        yield f'{name}{needed}: {quantity.components} {ways} <= {quantity.most:g} {quantity.unit}'
    sizes = {'delay_ticks': 1.0, 'stuck_off_thruster': 1.0, 'orbit_radius_m': 1000.0}
    seen = set()
    for case, (flown, _) in CASES.items():
        spreads = {}
        for name, quantity in QUANTITIES.items():
            acts = quantity.need is None or quantity.need.is_met(flown)
            if acts and not (name.startswith('navigation') and flown.named('sensors')):
                spreads[name] = {quantity.distributions[0]: 0}
        campaign = loaded(flown, dispersions=spreads, runs=1)
        none = draw(campaign, 0, 1)
        before = written_lines(campaign, none)
        yield case
        for i, name in enumerate(none.names):
            drawn = none._replace(parameters=none.parameters.copy())
            drawn.parameters[0, i] += sizes.get(name, 0.01)
            changed = [
                line.strip() for line in written_lines(campaign, drawn) if line not in before
            ]
            said = f'  {name}: {" | ".join(changed)}'
            if said not in seen:
                yield said
            seen.add(said)


def written_lines(campaign, drawn):
    """Return the lines of the file of the scenario of a run, or why there is none.

    Numbers are by seven digits.
    """
    try:
        text = scenario.dumps(run_batch.scenarios_of(campaign, drawn)[0])
    except InputError as error:
        text = str(error)
    return re.sub(r'-?\d+\.\d+(e-?\d+)?', lambda n: f'{float(n[0]) + 0.0:.7g}', text).splitlines()


def test_what_draws_change_is_what_the_list_says(loaded, monkeypatch):
    monkeypatch.setattr(yaml, 'SafeDumper', yaml.CSafeDumper)  # the same text, sooner
    assert_kept(Path(__file__).with_name('expected') / 'drawn.txt', drawn_lines(loaded))


@pytest.mark.parametrize('way', config.SAMPLINGS)
def test_a_run_has_the_same_draws_alone_and_beside_other_dispersions(way, loaded):
    few = {name: WORLD[name] for name in ('initial_position_m', 'mass_share', 'true_anomaly_deg')}
    alone = draw(loaded(LEO, dispersions=few, sampling=way, runs=45), 0, 45)
    beside = draw(loaded(LEO, dispersions=WORLD, sampling=way, runs=45), 12, 3)
    for name in ('initial_z_m', 'mass_kg', 'true_anomaly_deg'):
        np.testing.assert_array_equal(alone.column(name)[12:15], beside.column(name))
    strata = np.sort(np.floor((alone.column('true_anomaly_deg') / 180.0 + 1.0) / 2.0 * 45))
    assert way == 'random' or strata.tolist() == list(range(45))


@pytest.mark.parametrize(
    ('flown', 'dispersions', 'said'),
    [
        (PLAIN, {'density_share': {'uniform': 0.5}}, '`density_share` has no effect: scenario app'),
        (PLAIN, {'gyro_bias_x_rad_s': {'normal': 1e-5}}, 'has no `attitude_sensors`'),
        (PLAIN, {'chaser_rate_x_deg_s': {'normal': 0.1}}, 'has no `attitude`'),
        (PLAIN, {'true_anomaly_deg': {'uniform': 5.0}}, 'has no orbit but a circle'),
        (PLAIN, {'stuck_off_thruster': {'whole': 5}}, 'has no `pulses` of thrusters'),
        (PLAIN.equipped(FIRING), {'stuck_off_thruster': {'whole': 6}}, 'must be below 6'),
        (LEO, {'density_share': {'uniform': 1.5}}, '`dispersions.density_share.uniform` must be'),
        (LEO.equipped(replace(FIRING, delay_ticks=1)), SOME, 'no `matrix` and `delay_ticks`'),
    ],
)
def test_dispersions_that_cannot_act_are_one_sentence(flown, dispersions, said, loaded):
    with pytest.raises(InputError) as caught:
        loaded(flown, dispersions=dispersions)
    assert said in str(caught.value) and '\n' not in str(caught.value)


def test_a_run_that_no_scenario_allows_is_named(loaded):
    """The limits of the attitude's rate are looked at in each run, not at the extremes."""
    limits = AttitudeLimits(rate_deg_s=3.5, disturbance_nm=0.001)
    flown = PLAIN.equipped(STEERED, AttitudeControl(controller='attitude_pd', limits=limits))
    campaign = loaded(flown, dispersions={'chaser_rate_x_deg_s': {'normal': 1.3}}, runs=1000)
    fast = np.abs(draw(campaign, 0, 1000).column('chaser_rate_x_deg_s')) > 3.5
    first = int(np.argmax(fast))
    with pytest.raises(InputError, match=f'^run {first}: `attitude.rates_deg_s` must begin within'):
        fly_runs(campaign, 0, 1000)


# Campaigns with starts in a shell, and with plans and runtime assurance side by side.


@pytest.fixture(scope='module', params=['latin_hypercube', 'random'])
def drawn(request):
    campaign = config.load('docking', sampling=request.param)
    return draw(campaign, 0, 4000)


@pytest.mark.parametrize(('columns', 'least', 'most'), [((0, 3), 50.0, 200.0), ((3, 6), 0.0, 0.1)])
def test_directions_and_lengths_in_a_shell_are_equally_likely(drawn, columns, least, most):
    vectors = drawn.starts[:, slice(*columns)]
    length = np.linalg.norm(vectors, axis=1)
    assert length.min() >= least and length.max() <= most
    assert stats.kstest(length, 'uniform', (least, most - least)).pvalue > 0.001
    ahead = vectors / length[:, None]
    for axis in range(3):  # a component of a random direction is uniform, about any axis
        assert stats.kstest(ahead[:, axis], 'uniform', (-1.0, 2.0)).pvalue > 0.001
    skew = ahead @ np.array([1.0, -2.0, 2.0]) / 3.0
    assert stats.kstest(skew, 'uniform', (-1.0, 2.0)).pvalue > 0.001
    # Length, height and angle tell nothing of each other, as a table of 8 x 8 equal shares says.
    angle = np.arctan2(ahead[:, 1], ahead[:, 0])
    shares = [np.argsort(np.argsort(of)) * 8 // len(of) for of in (length, ahead[:, 2], angle)]
    for one, other in ((0, 1), (0, 2), (1, 2)):
        table = np.zeros((8, 8))
        np.add.at(table, (shares[one], shares[other]), 1)
        assert stats.chi2_contingency(table).pvalue > 0.001, (one, other)


# Message faults in campaigns: bits, the free-running plant, effects, refusals.

LOSSY = {
    'state_loss': 0.3,
    'state_delay': 0.2,
    'force_loss': 0.2,
    'force_delay': 0.3,
    'late_by_ticks': 3,
    'stale_after_ticks': 5,
}


def flown_alone(campaign, *numbers):
    """Return the flights of some runs, whose ends and energies are those of the campaign."""
    columns, flights = fly_runs(campaign, 0, 40), []
    for number in numbers:
        flight = run_batch.fly_run(campaign, number)
        final = [columns[name][number] for name in run_batch.FINAL]
        np.testing.assert_array_equal(final, flight.states[-1])
        energy = (flight.saturated_forces_n**2).sum() * campaign.scenario.dt_s
        assert columns['energy_n2s'][number] == pytest.approx(energy, rel=1e-12)
        flights.append(flight)
    return flights


def test_a_run_alone_has_the_bits_of_the_campaign(loaded):
    flown_alone(loaded(faults=LOSSY), 0, 7, 39)


def test_torques_are_lost_and_late_with_their_forces(loaded):
    """Bit for bit as the chain; and as no attitude control sent them."""
    turning = PLAIN.equipped(STEERED, AttitudeControl(controller='attitude_pd'))
    spread = {'chaser_rate_x_deg_s': {'normal': 0.1}}
    campaign = loaded(turning, faults=LOSSY, success=None, dispersions=spread)
    for flight in flown_alone(campaign, 0, 39):
        torque, force = flight.signals['body_torque'], flight.signals['applied_body_force']
        silent = ~torque.any(axis=1)
        assert 0 < silent[5:].sum() < len(torque) / 2
        assert not force[silent].any()
        held = (np.diff(force, axis=0) == 0.0).all(axis=1)
        assert held.sum() > 10 and not np.diff(torque, axis=0)[held].any()
        assert np.diff(torque, axis=0)[~held].any()


def test_it_is_what_the_free_running_plant_does(loaded):
    """The node's own plant, fed by hand with what comes when."""
    campaign = loaded(faults=LOSSY, dispersions={})
    scenario, controller = run_batch.scenario_of(campaign, 3), campaign.controller
    sent = campaign.config.faults.settings(draw(campaign, 3, 1).keys[0].tolist(), 3)
    fates = [faults.lateness(tick, sent) for tick in range(scenario.ticks)]
    plant = FreeRunningPlant(scenario, [CONTROL_FORCE, 'd'], stale_after_ticks=5)
    answers, stale = {}, 0
    for tick in range(scenario.ticks):
        answers[tick] = controller.force_n(plant.state[:3], plant.state[3:])
        for answered in range(tick + 1):
            if fates[answered] >= 0 and answered + fates[answered] == tick:
                plant.answer(CONTROL_FORCE, scenario.stamp_ns(answered), answers[answered])
        stale += CONTROL_FORCE in plant.stale
        push = tuple(scenario.disturbances_n[tick].tolist())
        plant.fly({CONTROL_FORCE: plant.applied(CONTROL_FORCE), DISTURBANCE_FORCE: push})
    assert set(fates) == {-1, 0, 3, 6}  # lost, in time, one message late, both
    assert stale > 0
    assert plant.state == tuple(run_batch.fly_run(campaign, 3).states[-1])


@pytest.mark.parametrize('name', faults.SHARES)
def test_every_fault_changes_the_flight_by_its_share(name, loaded):
    campaign = loaded(dispersions={}, faults={name: 0.4})
    plain = loaded(dispersions={})
    moved = fly_runs(campaign, 0, 40)['final_x_m'] != fly_runs(plain, 0, 40)['final_x_m']
    assert moved.all()
    sent = campaign.config.faults.settings((5, 6), 3)
    late = np.array([faults.lateness(t, sent) for t in range(5000)])
    hit = (late == faults.LOST) if name.endswith('loss') else (late == faults.LATE_BY_TICKS)
    assert hit.mean() == pytest.approx(0.4, abs=0.03)
    assert (late[~hit] == 0).all()


def test_when_all_is_lost_it_drifts(loaded):
    campaign = loaded(faults={'state_loss': 1.0}, runs=5)
    assert (fly_runs(campaign, 0, 5)['energy_n2s'] == 0.0).all()


def test_a_run_with_faults_is_no_scenario(tmp_path, write):
    done = invoke('campaign', write(faults=LOSSY), '--run', 3, '--export', tmp_path / 'x.yaml')
    assert done.exit_code == 2 and 'message faults' in done.stderr.splitlines()[-1]
    assert not (tmp_path / 'x.yaml').exists()


# A run whose numbers run out of range.


def test_a_run_that_is_lost_keeps_no_limit(loaded):
    """A stuck thruster spins a thin chaser up, until its attitude is no number.

    Comparisons pass over that.
    """
    thin = Chaser(
        inertia_kg_m2=((0.02, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        attitude=(0.3, 0.4, 0.8, 0.0),
    )
    stuck = Failure(thruster='y-b', stuck='on', from_s=0.5)
    table = ThrusterTable(preset='quads_16', force_n=0.5, failures=(stuck,))
    lost = replace(
        PLAIN,
        dt_s=0.25,
        requirements=Requirements(contact_range_m=0.1, contact_closing_speed_m_s=1.0),
    )
    lost = lost.equipped(thin, Thrusters(table=table))
    limits = {'hold_error_per_axis_m': 1e3, 'energy_n2s': 1e3, 'contact_closing_speed_m_s': 1e3}
    campaign = loaded(lost, dispersions={'thrust_share': {'normal': 0.01}}, success=limits)
    columns = fly_runs(campaign, 0, 3)
    assert not np.isfinite(columns['final_x_m']).any()
    for name in limits:
        assert not (columns[name] <= limits[name]).any(), name
