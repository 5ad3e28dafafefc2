# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The data of a replay: what the page holds is what was flown and judged."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from log_runs import make_run
from PIL import Image
from test_report import refuse_optima
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_core.judge.verdicts import verdicts
from rpo_report import replay, video
from rpo_report.replay import Replayed


def document(page: str) -> dict:
    """Return the data of a page."""
    (text,) = re.findall('<script type="application/json" id="data">(.*?)</script>', page)
    return json.loads(text)


def unpacked(text: str, width: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), '<f4').reshape(-1, width)


@pytest.fixture(scope='module')
def flight():
    return fly(load_scenario('paper_test'), load_controller('trained'))


def test_a_page_is_complete_and_small(flight):
    """4001 states with the rules of each second are below 3 MB, and stay what they were."""
    name = '</script><b>'
    shown = Replayed(name, flight, 'held', False, load_controller('trained'), [('in', 'now', 7)])
    page = replay.page_of(name, [shown])
    assert len(page.encode()) < 3e6
    assert "default-src 'none'" in page and 'http-equiv' in page and name not in page
    (found,) = document(page)['flights']
    assert found['name'] == name and found['phases'] == [['in', 'now', 0.7]]
    states = unpacked(found['states'], 6)
    assert (states == flight.states.astype('<f4')).all()
    forces = unpacked(found['forces'], 3)[:-1]
    np.testing.assert_allclose(forces, flight.saturated_forces_n, rtol=1e-6, atol=1e-9)
    words, samples = found['reasons']['words'], found['reasons']['samples']
    assert len(samples) == 401
    shares = np.array([[sum(cause[0] for cause in axis[1]) for axis in row] for row in samples])
    assert (shares > 60).all() and (shares < 103).all(), 'three causes are nearly all'
    assert any('position error is zero' in word for word in words)


def test_limits_of_a_moment_are_those_of_the_verdicts(flight):
    """The largest value from when a limit counts is the value of the verdict."""
    found = {limit.name: limit for limit in replay.limits_of(flight)}
    assert list(found) == [
        'position error per axis', 'speed per axis', 'force per axis', 'slew per axis',
    ]  # fmt: skip
    times = flight.scenario.times_s
    judged = {verdict.key: verdict for verdict in verdicts(flight)}
    for name, key in (
        ('position error per axis', 'hold_error_per_axis_m'),
        ('speed per axis', 'hold_speed_per_axis_m_s'),
        ('force per axis', 'hold_force_per_disturbance'),
        ('slew per axis', 'slew_per_axis_n_s'),
    ):
        limit = found[name]
        counts = times > limit.from_s if limit.from_s else times >= 0.0
        assert limit.limit == judged[key].limit
        assert np.nanmax(limit.values[counts]) == pytest.approx(judged[key].value, rel=1e-9)


def test_zones_count_only_where_a_scenario_has_them(flight):
    assert (
        document(replay.page_of('', [Replayed('', flight, '', False)]))['scene']['keep_out'] == []
    )
    scenario = replace(load_scenario('docking'), duration_s=2.0)
    docking = fly(scenario, load_controller('trained'))
    page = document(replay.page_of('', [Replayed('', docking, '', False)] * 2))
    assert page['scene']['keep_out'] == [10.0] and 'retreat' in page['scene']['points']
    assert page['scene']['ahead'] == [0.0, 1.0, 0.0] and len(page['flights']) == 2
    room = replay.limits_of(docking, np.ones((len(docking.states), 2)))
    assert [limit.name for limit in room if limit.floor] == [
        'clear of the keep-out zone', 'assurance: margin of position', 'assurance: margin of speed',
    ]  # fmt: skip
    away = np.linalg.norm(docking.positions_m, axis=1) - 10.0
    np.testing.assert_allclose(room[-3].values, away)


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['runs/none', '--video', 'a.gif'], 'runs/none is a controller'),
        (['a.mcap', 'b.mcap', '--video', 'a.gif'], '`--video` is of one run'),
        (['a.mcap', '--video', 'a.avi'], "must end in .gif or .mp4; got 'a.avi'"),
        (['a.mcap', 'trained'], 'several targets must be runs; a.mcap is a run, trained a contr'),
    ],
)
def test_targets_and_videos_that_do_not_fit_are_one_sentence(options, sentence):
    done = CliRunner().invoke(app, ['report', *options])
    assert done.exit_code == 2 and sentence in done.stderr and done.stderr.count('\n') == 1


def test_two_runs_beside_each_other_and_a_video(tmp_path, monkeypatch):
    monkeypatch.setattr(video, 'FRAMES', 3)
    refuse_optima(monkeypatch)
    for name, seconds in (('short', 20.0), ('long', 30.0)):
        make_run(seconds).write(tmp_path / name)
    runs = [str(tmp_path / name) for name in ('short', 'long')]
    done = CliRunner().invoke(app, ['report', *runs, '-o', str(tmp_path / 'both')])
    assert done.exit_code == 1, done.output
    page = (tmp_path / 'both' / 'replay.html').read_text('utf-8')
    found = document(page)['flights']
    assert [one['name'] for one in found] == ['short', 'long'] and all(o['missed'] for o in found)
    ends = [unpacked(one['times'], 1)[-1, 0] for one in found]
    assert ends == [20.0, 30.0]
    text = (tmp_path / 'both' / 'report.html').read_text('utf-8')
    assert 'The flights beside each other' in text and 'Replay 2 flights' in text
    video.write(make_run(20.0).flight, 'title', 'verdict', tmp_path / 'a.gif')
    with Image.open(tmp_path / 'a.gif') as picture:
        assert picture.n_frames == 3 and picture.size == (960, 540)
