# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the engine does not know is flown one by one, with the same columns, and it says so."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from campaign_documents import SHORT, write_campaign

from rpo_core.chain import stage
from rpo_core.chain.flight import fly
from rpo_core.chain.stage import Place, Section, Stage
from rpo_core.control.controller import load_controller
from rpo_core.control.controller_file import ControllerStage
from rpo_core.files.scenario import load_scenario, load_set
from rpo_core.files.starts import Cube
from rpo_core.judge import metrics
from rpo_core.wire.interfaces import APPLIED_FORCE, COMMAND
from rpo_core.world import cw
from rpo_ctrl.baselines import Pd
from rpo_kernels.jit import COMPILED
from rpo_montecarlo.campaign import config, run_batch, single
from rpo_montecarlo.engine import support
from rpo_montecarlo.engine.calls import rows_of
from rpo_montecarlo.engine.cases import case_of_flights, case_of_set
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.simulator import Simulator
from rpo_nav.navigation_errors import Navigation
from rpo_training import stepping


class LaggedStage(ControllerStage):
    """The force of the last state but one: a controller with memory."""

    memory_ticks = 1

    def __init__(self, inner):
        self.inner = inner

    def reset(self):
        self.last = (0.0, 0.0, 0.0)

    def step(self, tick, *inputs):
        force, (self.last,) = self.last, self.inner.step(tick, *inputs)
        return (force,)


class Lagged:
    name = 'lagged'
    provenance = ()

    def stage(self, dt_s):
        return LaggedStage(load_controller('pd').stage(dt_s))


@dataclass(frozen=True, kw_only=True)
class Halved(Pd):
    """A baseline whose law is not the whole truth."""

    def stage(self, dt_s):
        return LaggedStage(super().stage(dt_s))


@dataclass(frozen=True)
class Lag:
    """Settings of a stage that no part of the engine knows."""

    share: float = 0.5


class LagStage(Stage):
    """The force follows the command by a share of the difference at each tick."""

    name, inputs, outputs = 'lag', (COMMAND,), (APPLIED_FORCE,)
    memory_ticks = None

    def __init__(self, lag, _scenario):
        self.share = lag.share

    def reset(self):
        self.last = (0.0, 0.0, 0.0)

    def step(self, tick, *inputs):
        pairs = zip(self.last, inputs[0], strict=True)
        self.last = tuple(old + self.share * (new - old) for old, new in pairs)
        return (self.last,)


@pytest.fixture(autouse=True)
def forget():
    support._announced.clear()


def test_shipped_controllers_are_known_in_perfect_scenarios():
    scenario = load_scenario('paper_test')
    for name in ('trained', 'handmade', 'pd', 'lqr', 'mpc', 'apf_smc', 'drift'):
        assert support.why_not(scenario, load_controller(name)) == ''
    noisy = scenario.equipped(Navigation(position_noise_m=0.1))
    assert 'section `navigation`' in support.why_not(noisy, load_controller('pd'))
    halved = Halved(name='halved', position_gain_n_m=0.01, velocity_gain_n_s_m=0.5)
    for stranger in (Lagged(), halved):
        assert f'controller {stranger.name} has' in support.why_not(scenario, stranger)


def test_a_campaign_of_a_stranger_has_the_same_columns_and_says_so_once(tmp_path, capfd):
    campaign = config.load(write_campaign(tmp_path), controller='pd')
    strange = replace(campaign, controller=Lagged())
    columns = run_batch.fly_runs(strange, 0, 3)
    assert list(columns) == list(run_batch.fly_runs(campaign, 0, 3))
    for number in range(3):
        flight = single.fly_run(replace(strange, controller=Lagged()), number)
        final = [columns[name][number] for name in run_batch.FINAL]
        np.testing.assert_array_equal(final, flight.states[-1])
        row = metrics.row_of(flight)
        assert columns['energy_n2s'][number] == row[metrics.ENERGY]
        assert columns['delta_v_axis_sum_m_s'][number] == row[metrics.DELTA_V]
    run_batch.fly_runs(strange, 3, 1)
    said = capfd.readouterr().err
    assert (
        said.count('\n') == 1 and 'lagged has a stage of its own' in said and 'one by one' in said
    )


def test_a_section_of_a_plug_in_flies_in_a_campaign(tmp_path, monkeypatch, capfd):
    monkeypatch.setitem(stage.sections(), 'lag', Section('lag', Lag, Place.LINK, LagStage))
    scenario = tmp_path / 'lagging.yaml'
    scenario.write_text(SHORT + 'lag: {share: 0.25}\n')
    campaign = config.load(write_campaign(tmp_path, scenario=str(scenario)), controller='pd')
    assert support.why_not(campaign.scenario, campaign.controller).endswith('has a section `lag`')
    columns = run_batch.fly_runs(campaign, 7, 1)
    flight = single.fly_run(campaign, 7)
    assert flight.scenario.section(Lag) == Lag(0.25)
    final = [columns[name][0] for name in run_batch.FINAL]
    np.testing.assert_array_equal(final, flight.states[-1])
    assert 'section `lag`' in capfd.readouterr().err


MOON = {'body': cw.BODIES['moon'], 'orbit_radius_m': 1.9e6}


@pytest.mark.parametrize(
    'elsewhere',
    [{}, {'goal_position_m': (-3.0, 40.0, 7.0)}, {'goal_position_m': (0.0, 10.0, 0.0), **MOON}],
    ids=['target', 'goal', 'moon'],
)
def test_both_ways_give_the_same_rows(elsewhere, tmp_path, monkeypatch):
    """A campaign, and starts, of what the engine knows are flown singly to the same bits."""
    campaign = config.load(write_campaign(tmp_path))
    campaign = replace(campaign, scenario=replace(campaign.scenario, **elsewhere))
    base = replace(load_set('paper_training').base, duration_s=20.0, **elsewhere)
    training = case_of_set(
        replace(load_set('paper_training'), base=base, starts=Cube((50.0, -100.0))),
        horizon_s=30.0,
        late_s=5.0,
    )
    tests = [
        replace(load_scenario(name), duration_s=20.0, **elsewhere)
        for name in ('paper_test', 'paper_test_phase')
    ]
    cases = [training, case_of_flights(tests, 10.0)]
    controllers = [load_controller('trained'), load_controller('mpc')]

    def both():
        columns = run_batch.fly_runs(campaign, 38, 4)
        with Simulator(cases, 1) as simulator:
            return [*columns.values(), *simulator.fly(controllers)]

    quickly = both()
    for module in ('campaign.run_batch', 'engine.simulator'):
        monkeypatch.setattr(f'rpo_montecarlo.{module}.why_not', lambda *_: 'test')
    for ours, singly in zip(quickly, both(), strict=True):
        np.testing.assert_array_equal(ours, singly)


def test_strangers_are_flown_through_cases(capfd):
    test = replace(load_scenario('paper_test'), duration_s=20.0)
    case = case_of_flights([test], 10.0)
    with Simulator([case], 2) as simulator:
        (rows,) = simulator.fly([Lagged(), Lagged()])
    expected = metrics.row_of(fly(test, Lagged()), case.windows)
    np.testing.assert_array_equal(rows, [[expected], [expected]])
    assert capfd.readouterr().err.count('one by one') == 1


@compiled
def broken(w, memory, table, tick):
    if tick == 3:
        raise ValueError('flights differ')
    w[0] = w[0] + 1.0


def test_an_error_of_a_kernel_ends_the_flights():
    nothing, w = np.zeros(1), np.zeros((1, 1))
    rows = [rows_of([(broken, nothing, nothing)])]
    rows = np.array(rows) if COMPILED else rows
    for tick in range(3):
        stepping._pass(rows, tick, w)
    with pytest.raises(ValueError, match='flights differ'):
        stepping._pass(rows, 3, w)
    assert w[0, 0] == 3.0
