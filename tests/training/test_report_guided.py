# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of flights with guidance, assurance, an estimator and pulses."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from log_runs import chain_run
from pages import straight
from test_report import check_page, refuse_optima

from rpo.reports import logged, page, run, run_plots, stages
from rpo.reports.page import Fold, Table
from rpo.training.config import load_start
from rpo_core import files
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.control.controller import load_controller
from rpo_core.guidance.guidance import GuidanceStage
from rpo_core.navigation.estimator import EstimatorStage
from rpo_core.scenario import scenario
from rpo_core.wire import cdr
from rpo_core.world.zones import zones_of
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.verify import verify

LEGS = [
    {'name': 'wait', 'kind': 'hold', 'dwell_s': 2.0, 'go': 'command', 'within_m': 3.0,
     'within_m_s': 0.5},
    {'name': 'in', 'kind': 'straight', 'to_m': [0.0, 15.0, 0.0], 'speed_m_s': 0.3},
]  # fmt: skip
GO, HOLD = 30, 130


def whole():
    """Return a scenario with a section for every place of the chain, of 20 s."""
    plan = yaml.safe_load(files.read_text(files.find('scenario', 'hold_points')))
    world = yaml.safe_load(files.read_text(files.find('scenario', 'world_leo')))
    plan['guidance'] |= {'legs': LEGS}
    plan |= {name: world[name] for name in ('thrusters', 'sensors', 'estimator')}
    plan |= {'initial_position_m': [0.0, 18.0, 0.0], 'duration_s': 20.0}
    plan['estimator'] |= {'position_sigma_m': 0.1}
    plan['assurance'] = {
        'keep_out_m': 10.0, 'speed': {'speed_m_s': 0.1}, 'position_error_m': 0.2,
        'velocity_error_m_s': 0.02, 'disturbance_n': 0.02, 'thrust_error': 0.1,
    }  # fmt: skip
    return scenario.parse(plan)


def said(name, tick):
    values = {'stage': 'guidance', 'state': name, 'tick': str(tick), 'reason': 'test'}
    return '/stage_status', tick, cdr.encode_status(1, 'guidance', name, 'none', values)


@pytest.fixture(scope='module')
def flown(tmp_path_factory):
    """The log of a flight that an operator commanded, and the flight."""
    reset, flown = GuidanceStage.reset, whole()

    def commanded(stage):
        reset(stage)
        stage.commands |= {GO: 'go', HOLD: 'hold'}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GuidanceStage, 'reset', commanded)
        events = (said('go', GO), said('hold', HOLD))
        made = chain_run(flown, load_start('trained'), events=events)
    path = tmp_path_factory.mktemp('whole')
    made.write(path)
    return read_run(path), made.flight


def test_stages_run_again_give_what_was_logged(flown):
    """The estimator read the command before assurance, and NEES was some hundreds."""
    log, made = flown
    assert verify(log.path).exit_code == 0
    for kind in (GuidanceStage, EstimatorStage, AssuranceStage):
        rows = list(logged.steps_again(log, flight_of(log), kind))
        assert [tick for tick, _, _ in rows] == list(range(len(made.states)))
        for i, name in enumerate(rows[0][1].outputs):
            np.testing.assert_array_equal([row[2][i] for row in rows], made.signals[name])
    assert (made.signals['assured_force'] != made.forces_n).any(), 'else it proves less'
    assert stages.filtered(log, flight_of(log)).nees.mean() < 20.0


def test_phases_and_interventions_are_told_as_they_were(flown):
    log, made = flown
    flight = flight_of(log)
    phases = stages.phases_of(log, flight)
    assert [(p.name, p.begin) for p in phases] == [('wait', 0), ('in', GO), ('stopped', HOLD)]
    assert [p.end for p in phases] == [GO, HOLD, len(made.states)]
    acted = stages.decided(log, flight)
    changed = np.linalg.norm(made.signals['assured_force'] - made.forces_n, axis=1)
    np.testing.assert_allclose(acted.changed_n, changed, atol=1e-12)
    ticks = np.zeros(len(changed), dtype=bool)
    for one in stages.interventions(acted.constraints):
        ticks[one.begin : one.end] = True
    assert ticks[changed > 0.0].all() and ticks.any() and not ticks.all()
    assert (acted.margins[ticks].min(axis=1) < 0.0).all(), 'a margin is why it acts'


@pytest.fixture(scope='module')
def made(flown):
    with pytest.MonkeyPatch.context() as patch:
        refuse_optima(patch)
        return run.report_of(flown[0].path)[0]


def table(made, caption):
    blocks = [block for section in made.sections for block in section.blocks]
    blocks += [inner for block in blocks if isinstance(block, Fold) for inner in block.blocks]
    return next(b for b in blocks if isinstance(b, Table) and b.caption.startswith(caption))


@pytest.mark.every_landing
def test_the_page_has_a_part_for_each_stage(made, flown):
    text = check_page(page.html(made), made).all('main')[0].text
    titles = [section.title for section in made.sections]
    assert titles[1:4] == ['Time histories', 'Guidance', 'Assurance'] and 'Navigation' in titles
    names = [p.name for p in made.pictures]
    assert {'zones', 'guidance', 'assurance', 'pulses', 'navigation'} <= set(names)
    assert [row[0] for row in table(made, 'Phases').rows] == ['wait', 'in', 'stopped']
    who = table(made, 'Who acted').rows[0]
    acted = stages.decided(flown[0], flight_of(flown[0]))
    assert who[0] == 'speed' and float(who[2]) == pytest.approx(
        0.1 * acted.constraints.count('speed')
    )
    assert dict(table(made, 'Passage of the zones').rows)[
        '`zones`: enters the keep-out sphere of 10 m'
    ] == ('never')
    assert 'relative to the reference' in text


def along(start, end):
    return straight('hold_points', start, end, 200)


def test_passage_of_zones_on_straight_lines():
    (zones,) = zones_of(scenario.load_scenario('hold_points'))
    inside = dict(run_plots.zone_passage(along([0.0, 21.0, 0.0], [0.0, 1.0, 0.0]), zones))
    assert inside['ticks in the keep-out sphere of 10 m outside the corridor'] == 'none'
    # 1 m/s from 21 m: at 11 s it is at 10 m, and the sphere begins below
    assert inside['enters the keep-out sphere of 10 m at'] == '11.1 s'
    assert inside['closing speed at the entry'] == '1 m/s'
    # from the other side: from 10 m to 4.5 m behind the target, where the corridor ends
    beside = dict(run_plots.zone_passage(along([0.0, -21.0, 0.0], [0.0, -1.0, 0.0]), zones))
    assert beside['ticks in the keep-out sphere of 10 m outside the corridor'] == '54 of 201'
    rest = along([0.0, 21.0, 0.0], [0.0, 1.0, 0.0])
    rest.states[-5:, :3] = (0.02, 1.0, 0.0)  # at the port, beside the tip of the cone
    passed = dict(run_plots.zone_passage(rest, zones))
    assert passed['ticks in the keep-out sphere of 10 m outside the corridor'] == 'none'
    away = dict(run_plots.zone_passage(along([0.0, 21.0, 0.0], [0.0, 41.0, 0.0]), zones))
    assert away['enters the keep-out sphere of 10 m'] == 'never'


@pytest.mark.every_landing
def test_a_phase_may_last_no_tick(tmp_path):
    """The shipped `docking` arrives and docks at one tick: its report ended in a stack of calls."""
    chain_run(scenario.load_scenario('docking'), load_controller('allround')).write(tmp_path)
    log = read_run(tmp_path)
    flight = flight_of(log)
    phases = stages.phases_of(log, flight)
    arrived, docked = phases[-2:]
    assert (arrived.name, docked.name) == ('arrived', 'docked')
    assert arrived.begin == arrived.end == docked.begin < docked.end
    (told,) = [
        b for s in stages.guidance_sections(flight, phases) for b in s.blocks if type(b) is Table
    ]
    (row,) = [row for row in told.rows if row[0] == 'arrived']
    assert row[1] == row[2] == '600.0' and row[3:6] == ('–', '–', '–')
