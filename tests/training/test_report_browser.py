# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whole reports in a real browser: nothing is fetched, nothing complains, light, dark, printed."""

from __future__ import annotations

import re
import shutil
import time

import numpy as np
import pytest
import test_report_attitude
import test_report_guided
from browser import browser
from campaign_documents import write_campaign
from invoking import invoke
from log_runs import chain_run, make_run
from pages import Page
from PIL import Image
from test_report import check_page

from rpo.montecarlo import config, execution
from rpo.montecarlo.store import Store
from rpo.reports import campaign, controller, page, run
from rpo.reports.replay import Replayed, page_of
from rpo.training.config import load_start
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario import scenario
from rpo_core.wire.interfaces import CHASER_ATTITUDE, EXERTED_FORCE

CHROMIUM = shutil.which('chromium')

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed'),
]

A4_PX = 680  # 180 mm between the margins, at 96 dpi
BACKGROUND = 'getComputedStyle(document.documentElement).backgroundColor'
FIGURES = """[...document.querySelectorAll('main svg[role=img]')].map(drawing => {
  const box = drawing.getBoundingClientRect(), line = drawing.querySelector('path');
  const text = drawing.querySelector('text');
  return {width: box.width, height: box.height, texts: drawing.querySelectorAll('text').length,
          colour: text && getComputedStyle(text).fill, stroke: getComputedStyle(line).stroke};
})"""
WIDE = """[...document.querySelectorAll('main table, main figure, main p')]
  .filter(e => e.getBoundingClientRect().right > innerWidth + 1)
  .map(e => e.outerHTML.slice(0, 80))"""


def run_report(folder):
    make_run(200.0).write(folder)
    return run.report_of(folder)[0]


def campaign_report(folder):
    store = Store.create(folder / 'flown', config.load(write_campaign(folder)))
    execution.fly(store, 1)
    return campaign.report_of(store.folder)


def controller_report(folder):
    return controller.report_of('allround')


def baseline_report(folder):
    return controller.report_of('mpc')


@pytest.mark.parametrize('make', [run_report, campaign_report, controller_report, baseline_report])
def test_a_report_in_chromium(make, tmp_path):
    made = make(tmp_path)
    *pictures, path = page.write(made, tmp_path / 'report')
    pictures = [p for p in pictures if p.name != page.REPLAY]
    assert [p.name for p in pictures] == [f'{p.name}.png' for p in made.pictures]
    assert all(p.read_bytes().startswith(b'\x89PNG') for p in pictures)
    check_page(path.read_text('utf-8'), made)
    seen = {}
    with browser(CHROMIUM, tmp_path / 'profile') as shown:
        for theme in ('light', 'dark'):
            shown.open(path, theme=theme)
            seen[theme] = shown.evaluate(FIGURES)
            assert shown.evaluate('document.body.scrollWidth <= innerWidth')
            assert shown.evaluate(WIDE) == []
            white, black = 'rgb(255, 255, 255)', 'rgb(20, 22, 26)'
            assert shown.evaluate(BACKGROUND) == {'light': white, 'dark': black}[theme]
        shown.open(path, width=400)
        assert shown.evaluate('document.body.scrollWidth <= innerWidth'), 'a telephone scrolls down'
        shown.open(path, width=A4_PX, theme='dark', media='print')
        assert shown.evaluate(WIDE) == [], 'nothing is cut on paper'
        assert shown.evaluate(BACKGROUND) == 'rgb(255, 255, 255)', 'paper is white'
        shown.open(path, theme='dark')
        shown.print(tmp_path / 'report.pdf')
        assert shown.messages == []
        assert set(shown.requests) == {path.resolve().as_uri()}
    for theme in seen:
        assert len(seen[theme]) == len(made.pictures)
        assert all(f['width'] > 500 and f['height'] > 100 for f in seen[theme])
        assert all(f['texts'] > 5 for f in seen[theme])
    for light, dark in zip(seen['light'], seen['dark'], strict=True):
        assert light['colour'] != dark['colour'], 'pictures follow the theme'
    pdf = (tmp_path / 'report.pdf').read_bytes()
    assert pdf.startswith(b'%PDF-') and len(re.findall(rb'/Type\s*/Page\b', pdf)) >= 3


def test_an_aborted_run_by_command(tmp_path):
    whole = make_run(20.0)
    whole.write(tmp_path, [m for m in whole.messages if m[1] <= 120])
    done = invoke('report', tmp_path, '-o', tmp_path / 'report')
    assert done.exit_code == 3 and 'ends at tick 120 of 200' in done.stderr, done.output
    main = Page((tmp_path / 'report' / 'report.html').read_text('utf-8')).all('main')[0]
    assert 'The log shows 12 of 20 s: it ends' in main.text
    assert not [td for td in main.text.split() if td in ('holds', 'MISSED')]
    assert 'it would take arrival_distance' in main.text, 'no optimum in 20 s, and why'


def test_a_replay_in_chromium(tmp_path, capsys):
    """A flight with every stage is drawn, turned, played and scrubbed, by keys too."""
    made = chain_run(test_report_guided.whole(), load_start('trained'))
    made.write(tmp_path / 'whole')
    run_report(tmp_path / 'paper')
    done = invoke('report', tmp_path / 'whole', tmp_path / 'paper', '-o', tmp_path)
    assert done.exit_code == 1, done.output
    path = tmp_path / page.REPLAY
    with browser(CHROMIUM, tmp_path / 'profile') as shown:
        for width, theme in ((1280, 'dark'), (390, 'light')):
            shown.open(path, width=width, theme=theme)
            shown.wait('window.replay && replay.stats.frames > 0')
            assert shown.evaluate('document.body.scrollWidth <= innerWidth')
            shown.screenshot(tmp_path / f'{theme}.png')
            with Image.open(tmp_path / f'{theme}.png') as picture:
                scene = picture.convert('RGB').crop((0, 100, min(width, 850), 400))
            assert len(scene.getcolors(1 << 20)) > 100, 'the scene is drawn'
        first = shown.evaluate('replay.stats.first_ms')
        shown.open(path, width=1280)
        shown.wait('replay.stats.frames > 0')
        assert shown.evaluate("[...document.querySelectorAll('#flights button')].length") == 2
        for key, code, modifiers, t in (
            ('ArrowRight', 39, 8, 10.0), ('ArrowLeft', 37, 0, 9.0), ('.', 190, 0, 9.1),
            ('End', 35, 0, 200.0), ('Home', 36, 0, 0.0),
        ):  # fmt: skip
            shown.press(key, code, modifiers)
            assert shown.evaluate('replay.now') == pytest.approx(t, abs=1e-3), key
        shown.press('n', 78)
        shown.evaluate('replay.seek(150)')
        shown.wait("document.querySelector('#axes').textContent.includes('because')")
        rows = "[...document.querySelectorAll('#limits > div')].map(row => row.textContent)"
        assert any('slew per axis' in row for row in shown.evaluate(rows))
        shown.evaluate('replay.seek(0), replay.setSpeed(1)')
        shown.press('ArrowUp', 38)
        shown.press(' ', 32)
        shown.wait('replay.now > 2')
        begun = shown.evaluate('[performance.now(), replay.stats.frames, replay.now]')
        time.sleep(2.0)
        ended = shown.evaluate('[performance.now(), replay.stats.frames, replay.now]')
        shown.press(' ', 32)
        assert not shown.evaluate('replay.playing')
        passed_ms, frames, flown_s = (b - a for a, b in zip(begun, ended, strict=True))
        assert flown_s == pytest.approx(2.0e-3 * passed_ms, rel=0.3), 'twice as fast as it flew'
        said = [text for text in shown.messages if 'ReadPixels' not in text]  # of a screenshot
        assert said == [] and set(shown.requests) == {path.resolve().as_uri()}
    rate = 1e3 * frames / passed_ms
    with capsys.disabled():
        print(f'\nreplay: first frame {first:.0f} ms, {rate:.0f} frames/s')
    assert rate > 5.0, 'it moves, on a busy machine too'


def test_the_replay_of_a_chaser_that_turns(tmp_path):
    """It is drawn as it was; beside a flight without attitude it says no more of it."""
    flight = fly(scenario.parse(test_report_attitude.document()), load_controller('allround'))
    path = tmp_path / page.REPLAY
    shown_of = [
        Replayed('turns', flight, '', None),
        Replayed('not', make_run(20.0).flight, '', None),
    ]
    path.write_text(page_of('two', shown_of), encoding='utf-8')
    with browser(CHROMIUM, tmp_path / 'profile') as shown:
        shown.open(path, width=1280)
        shown.wait('window.replay && replay.stats.frames > 0')
        for tick in (0, 57, 200):
            frames = shown.evaluate(f'replay.seek({0.1 * tick}), replay.stats.frames')
            shown.wait(f'replay.stats.frames > {frames}')
            drawn = np.array(shown.evaluate('chaser.quaternion.toArray()'))
            known = flight.signals[CHASER_ATTITUDE][tick, :4]
            assert abs(drawn @ known) == pytest.approx(1.0, abs=1e-6), tick
            force = flight.signals[EXERTED_FORCE][min(tick, 199)]
            along = np.array(
                shown.evaluate('V(0, 1, 0).applyQuaternion(arrow.quaternion).toArray()')
            )
            assert tick == 200 or along @ force / np.linalg.norm(force) > 0.999
        names = "[...document.querySelectorAll('#figures > div')].filter(d => !d.hidden)"
        names += '.map(d => d.firstChild.textContent)'
        turns = ['off reference', 'turn rate', 'θ of the command']
        assert shown.evaluate(names)[3:] == turns
        assert shown.evaluate('views.length === 1 && docking.visible')
        frames = shown.evaluate('replay.choose(1), replay.stats.frames')
        shown.wait(f'replay.stats.frames > {frames}')
        assert len(shown.evaluate(names)) == 3 and not shown.evaluate('docking.visible')
        assert shown.evaluate('chaser.quaternion.toArray()') == [0, 0, 0, 1]
        assert [text for text in shown.messages if 'ReadPixels' not in text] == []
