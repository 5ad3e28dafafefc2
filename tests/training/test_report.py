# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo report`: what the page holds, that it needs nothing else, and what is refused."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import write_campaign
from hypothesis import given, settings
from hypothesis import strategies as st
from invoking import invoke, refused
from landing import rest_at_landing
from log_runs import FORCE, Run, make_run
from pages import Page, replayed, straight, unpacked

from rpo.analysis import optimal
from rpo.montecarlo import config, execution
from rpo.montecarlo.store import Store
from rpo.reports import campaign, logged, page, replay, run
from rpo.reports.page import File, Picture, Report, Section, Table, Text
from rpo.reports.replay import Replayed
from rpo.training.config import load_start
from rpo_core.chain.flight import fly
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import load_scenario
from rpo_log.errors import LogError
from rpo_log.read.run_log import read_run
from rpo_log.show import style

UNITLESS = {
    'word of the position error', 'word of the velocity error', 'grade', 'number of runs',
    'rank correlation', 'share of its limit', 'starts that stay below', 'controllers evaluated', '',
    'NEES', 'innovation / sigma',
}  # fmt: skip


@pytest.fixture(scope='module')
def short_run() -> Run:
    return make_run(20.0)


@pytest.fixture(scope='module')
def folder(short_run, tmp_path_factory):
    path = tmp_path_factory.mktemp('flown')
    assert short_run.write(path).whole
    return path


def refuse_optima(patch):
    """Let there be no cvxpy: an optimum is a sentence."""

    def refuse(*_):
        raise InputError('the optimum needs the campaign layer')

    patch.setattr(optimal, 'constrained', refuse)


def campaign_of(folder, **changes):
    """Fly a campaign of 90 runs."""
    store = Store.create(folder / 'flown', config.load(write_campaign(folder, **changes)))
    execution.fly(store, 1)
    return store


@pytest.fixture(scope='module')
def store(tmp_path_factory):
    return campaign_of(tmp_path_factory.mktemp('campaign'))


def check_page(source: str, made: Report) -> Page:
    """Whether a page is whole, accessible and alone in the world; return it."""
    found = Page(source)
    ids = [e.attributes['id'] for e in found.elements if 'id' in e.attributes]
    assert len(ids) == len(set(ids)), 'identifiers must be unique'
    assert len(found.all('h1')) == 1 and found.all('html')[0].attributes['lang'] == 'en'
    assert [h.text for h in found.all('h2')] == [s.title for s in made.sections]
    links = [a.attributes['href'] for a in found.all('a') if 'svg' not in a.path]
    beside = ['replay.html'] if made.flights else []
    assert beside == [link for link in links if link[0] != '#']
    assert all(link[1:] in ids for link in links if link[0] == '#')
    assert "default-src 'none'" in source and not found.all('script') and not found.all('img')
    for element in found.elements:
        for name in ('src', 'href', 'xlink:href', 'style', 'data'):
            assert 'http' not in element.attributes.get(name, ''), element
    assert not re.search(r'@import|url\((?!#)', source)
    for table in found.all('table'):
        assert 'section' in table.path
    assert len(found.all('caption')) == len(found.all('table'))
    assert all(th.attributes.get('scope') for th in found.all('th'))
    check_pictures(found, made)
    return found


def check_pictures(found: Page, made: Report) -> None:
    drawings = [e for e in found.all('svg') if e.attributes.get('role') == 'img']
    assert [d.attributes['aria-label'] for d in drawings] == [p.alt for p in made.pictures]
    assert all(len(d.attributes['aria-label']) > 15 and d.text.strip() for d in drawings)
    assert len(found.all('figcaption')) == len(drawings)
    for picture in made.pictures:
        check_labels(picture)


def check_labels(picture: Picture) -> None:
    """Whether every axis that has a scale says what it shows, in what unit."""
    labels = []
    for axes in picture.figure.axes:
        if axes.axison:
            labels += [axes.get_xlabel(), axes.get_ylabel()]
            labels += [axes.get_zlabel()] if hasattr(axes, 'get_zlabel') else []
    assert sum(label != '' for label in labels) >= 1, picture.name
    check_ticks(picture)
    for label in labels:
        assert label in UNITLESS or re.search(r'\[.+\]$', label), (picture.name, label)


@pytest.fixture(scope='module')
def run_page(folder, tmp_path_factory):
    """The report of a run without cvxpy, and its page."""
    with pytest.MonkeyPatch.context() as patch:
        refuse_optima(patch)
        made, shown = run.report_of(folder)
    assert shown.whole
    return made, page.html(made)


def check_ticks(picture: Picture) -> None:
    """Whether the numbers along each axis stay clear of each other."""
    picture.figure.draw_without_rendering()
    for axes in picture.figure.axes:
        if not axes.axison or hasattr(axes, 'get_zlabel'):
            continue
        for axis, low, high in ((axes.xaxis, 'x0', 'x1'), (axes.yaxis, 'y0', 'y1')):
            labels = [t.label1 for t in axis.get_major_ticks() if t.label1.get_visible()]
            assert not any('$' in label.get_text() for label in labels), picture.name
            boxes = [t.get_window_extent() for t in labels if t.get_text()]
            boxes = sorted(boxes, key=lambda box: getattr(box, low))
            for one, next_ in itertools.pairwise(boxes):
                assert getattr(one, high) < getattr(next_, low), (picture.name, axis, boxes)


def test_a_run(run_page):
    made, source = run_page
    text = check_page(source, made).all('main')[0].text
    assert 'No optimum is shown: the optimum needs the campaign layer.' in text
    assert 'disturbance: paper_offset' in text, 'the scenario is attached'
    assert [p.name for p in made.pictures] == [
        'approach',
        'time_histories',
        'energy',
        'limits',
        'disturbance',
        'phase_planes',
    ]


def test_the_first_table_of_a_run_has_values_limits_and_margins_of_the_verdicts(
    run_page, short_run
):
    table = next(b for b in run_page[0].sections[0].blocks if isinstance(b, Table))
    found = verdicts(short_run.flight)
    assert len(table.rows) == len(found) > 3
    for row, v in zip(table.rows, found, strict=True):
        cells = dict(zip(('what', 'value', 'limit', 'margin', 'word'), row, strict=True))
        assert cells['what'] == v.statement and cells['word'] == v.word
        if math.isfinite(v.value):
            share = float(cells['margin'].removesuffix(' %')) / 100.0
            assert share == pytest.approx(1.0 - v.value / v.limit, abs=0.0051)


def test_a_log_that_ends_early_shows_a_shorter_flight(short_run, tmp_path):
    messages = [m for m in short_run.messages if m[1] <= 120]
    lost = [m for m in messages if m[:2] != (FORCE, 100)]
    for name, sent, last in (('cut', messages, 120), ('hole', lost, 99)):
        short_run.write(tmp_path / name, sent)
        shown = logged.logged_flight(read_run(tmp_path / name))
        assert not shown.whole and 'ends at tick 120 of 200' in '; '.join(shown.gaps)
        assert shown.flight.scenario.ticks == last and shown.planned.ticks == 200
        assert (shown.flight.states == short_run.flight.states[: last + 1]).all()
    short_run.write(tmp_path / 'stub', [m for m in messages if m[1] <= 5])
    with pytest.raises(LogError, match='must hold a whole flight'):
        logged.logged_flight(read_run(tmp_path / 'stub'))


@pytest.mark.parametrize(('limit', 'kept'), rest_at_landing([(1e6, '90 / 90'), (0.0, '0 / 90')]))
def test_a_campaign_where_every_run_succeeds_or_none(limit, kept, tmp_path):
    store = campaign_of(tmp_path, success={'hold_error_per_axis_m': limit})
    made = campaign.report_of(store.folder)
    sections = {section.title: section for section in made.sections}
    rates, worst = (
        next(b for b in sections[title].blocks if isinstance(b, Table))
        for title in ('Success', 'Worst runs')
    )
    assert rates.rows[0][:2] == ('success', kept)
    assert rates.rows[1][0] == f'hold error per axis ≤ {limit:g} m'  # no raw column name
    assert not any('_' in row[0] for s in made.sections for b in s.blocks
                   if isinstance(b, Table) for row in b.rows)  # fmt: skip
    run = int(np.argmax(store.column('hold_error_per_axis_m')))
    assert [b.title for b in made.sections].count('Where it ends') == 1
    assert worst.rows[1][-1] == f'rpo campaign {store.folder} --run {run}'
    assert made.flights[0].name == (f'run {run}' if limit else made.flights[0].name)
    said = 'Largest beside its limit' if limit else 'Missed, in the order of a flight'
    assert f'{said}: hold error per axis: ' in made.flights[0].verdict
    headings = [row[0] for row in worst.rows if len(row) == 1]
    failures = [] if limit else ['90 of 90 failures miss first: hold error per axis']
    assert headings == ['worst of each figure', *failures]
    if not limit:
        assert worst.rows[3][0] == f'run {run}', 'the farthest beyond comes first'


def test_a_campaign_that_still_flies_and_a_folder_that_takes_nothing(store, tmp_path):
    begun = Store.create(tmp_path / 'begun', store.campaign)
    assert 'go on with rpo campaign --resume' in refused('report', begun.folder)
    (tmp_path / 'file').write_text('')
    with pytest.raises(InputError, match=r'file: cannot be written: File exists'):
        page.write(Report('', '', ()), tmp_path / 'file')


@settings(max_examples=15)
@given(st.text(st.characters(exclude_categories=['Cs', 'Cc']), min_size=1))
def test_no_text_of_a_file_becomes_markup(text):
    blocks = (Text(text), Table(text, (text, text), ((text, text), (text,))), File(text, text))
    source = page.html(Report(text, text, (Section('s', blocks),)))
    found = Page(source)
    tags = {element.tag for element in found.elements}
    assert tags <= {
        *('html', 'head', 'meta', 'title', 'link', 'style', 'body', 'header', 'h1', 'p', 'nav'),
        *('ul', 'li', 'a', 'main', 'section', 'h2', 'div', 'table', 'caption', 'thead', 'tbody'),
        *('tr', 'th', 'td', 'details', 'summary', 'pre', 'code'),
    }
    assert found.all('h1')[0].text == text
    assert [e.text for tag in ('caption', 'td', 'summary', 'code') for e in found.all(tag)] == [
        text
    ] * 4


SLEW = Requirements(slew_per_axis_n_s=0.1)


NAMES = [
    '#123456', 'colour #0072b2', 'a id="b" url(#c) xlink:href="#d" d="0.12345"',
    '</text></svg><script>', "$a$ | 'b' & é", 'two  spaces',
]  # fmt: skip


def test_a_picture_has_a_name_as_it_is():
    """Whatever a leg or a run is called: patterns are for tags."""
    with style.applied():
        figure = style.new_figure(2.0)
        axes = figure.subplots()
        for name in NAMES:
            axes.plot([0.0, 1.0], [0.0, 1.0], label=name)
            axes.annotate(name, (0.5, 0.5))
        style.legend_below(figure, axes)
        source = page.svg(Picture('one', figure, '', 'a line'))
    found = [element.text for element in Page(source).all('text')]
    assert [found.count(name) for name in NAMES] == [2] * len(NAMES)
    assert not re.findall('#[0-9a-f]{6}', re.sub('>[^<]*<', '', source))


def test_influence_is_of_the_deviation_or_of_its_size():
    rng = np.random.default_rng(1)
    a, b, noise = rng.uniform(-1.0, 1.0, (3, 400))
    drawn = {'a': a, 'b': b, 'noise': noise, 'constant': np.ones(400)}
    found = {i.column: i for i in campaign.influences(drawn, a**3 + b**2 + 0.1 * noise)}
    assert set(found) == {'a', 'b', 'noise'}
    assert found['a'].signed > 0.5 > found['noise'].strength
    assert abs(found['b'].signed) < 0.2 < found['b'].size, 'either side does the same'
    assert campaign.influences(drawn, np.ones(400)) == []


def test_the_verdict_in_words():
    flight = straight('approach', [0.0, -50.0, 0.0], [0.0, 0.0, 0.0], 100)  # 5 m/s, in 10 s
    assert metrics.arrival_time_s(flight) == pytest.approx(9.9, abs=0.11)  # it is 0.5 m away
    assert logged.verdict_of(flight, ['the log ends']) == 'Not judged: the log ends.'
    said = logged.verdict_of(flight)
    assert said.startswith(
        '2 of 3 requirements missed. mean error (norm), last 10 s: 24.8 of 0.5 m'
    )
    still = straight('approach', [0.0, 0.1, 0.0], [0.0, 0.1, 0.0], 100)
    said = 'All 3 requirements hold. The tightest is mean error (norm), last 10 s: 0.1 of 0.5 m.'
    assert logged.verdict_of(still) == said
    free = replace(still, scenario=replace(still.scenario, requirements=None))
    assert logged.verdict_of(free) == 'The scenario has no requirements.'
    slew = replace(still, scenario=replace(free.scenario, requirements=SLEW))
    said = 'The requirement holds. The tightest is slew per axis: 0 of 0.1 N/s. '
    assert logged.verdict_of(slew) == said + 'No requirement bounds arrival, end state.'


# The data of a replay: what the page holds is what was flown and judged.


@pytest.fixture(scope='module')
def flight():
    return fly(load_scenario('paper_test'), load_start('trained'))


def test_a_page_is_complete_and_small(flight):
    """4001 states with the rules of each second are below 3 MB, and stay what they were."""
    name = '</script><b>'
    shown = Replayed(name, flight, 'held', False, load_start('trained'), [('in', 'now', 7)])
    page = replay.page_of(name, [shown])
    assert len(page.encode()) < 3e6
    assert "default-src 'none'" in page and 'http-equiv' in page and name not in page
    (found,) = replayed(page)['flights']
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
        replayed(replay.page_of('', [Replayed('', flight, '', False)]))['scene']['keep_out'] == []
    )
    scenario = replace(load_scenario('docking'), duration_s=2.0)
    docking = fly(scenario, load_start('trained'))
    page = replayed(replay.page_of('', [Replayed('', docking, '', False)] * 2))
    assert page['scene']['keep_out'] == [10.0] and 'retreat' in page['scene']['points']
    assert page['scene']['ahead'] == [0.0, 1.0, 0.0] and len(page['flights']) == 2
    room = replay.limits_of(docking, np.ones((len(docking.states), 2)))
    assert [limit.name for limit in room if limit.floor] == [
        'clear of the keep-out zone', 'assurance: margin of position', 'assurance: margin of speed',
    ]  # fmt: skip
    away = np.linalg.norm(docking.positions_m, axis=1) - 10.0
    np.testing.assert_allclose(room[-3].values, away)


def test_two_runs_beside_each_other(short_run, tmp_path, monkeypatch):
    refuse_optima(monkeypatch)
    short_run.write(tmp_path / 'short')
    make_run(30.0).write(tmp_path / 'long')
    runs = [str(tmp_path / name) for name in ('short', 'long')]
    done = invoke('report', *runs, '-o', tmp_path / 'both')
    assert done.exit_code == 1, done.output
    page = (tmp_path / 'both' / 'replay.html').read_text('utf-8')
    found = replayed(page)['flights']
    assert [one['name'] for one in found] == ['short', 'long'] and all(o['missed'] for o in found)
    ends = [unpacked(one['times'], 1)[-1, 0] for one in found]
    assert ends == [20.0, 30.0]
    text = (tmp_path / 'both' / 'report.html').read_text('utf-8')
    assert 'The flights beside each other' in text and 'Replay 2 flights' in text
