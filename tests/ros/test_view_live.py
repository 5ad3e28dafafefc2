# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The live page in a browser while real nodes fly.

RPO_PICTURES=docs/images draws the pictures of docs/viewing.md anew.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from pathlib import Path

import pytest
from browser import browser
from node_processes import node_processes

from rpo_core.files import DEFAULT_CONTROLLER

CHROMIUM = shutil.which('chromium')
DEADLINE_S = 60.0
WIDTH = 1180
FLIGHT = (
    'final_approach', '--scenario', 'paper_test', '--real-time-factor', '10', '--no-report',
)  # fmt: skip

pytestmark = pytest.mark.slow


def look(page, width: int, theme: str) -> None:
    """Set the window's width and the reader's theme."""
    page.call(
        'Emulation.setDeviceMetricsOverride',
        width=width, height=880, deviceScaleFactor=1, mobile=False,
    )  # fmt: skip
    page.call('Emulation.setScrollbarsHidden', hidden=True)
    feature = {'name': 'prefers-color-scheme', 'value': theme}
    page.call('Emulation.setEmulatedMedia', features=[feature])


def until(page, expression: str) -> None:
    """Wait until a JavaScript expression is true."""
    end = time.monotonic() + DEADLINE_S
    while not page.evaluate(expression):
        assert time.monotonic() < end, (expression, page.messages)
        time.sleep(0.1)


def opened(ros, page):
    """Start the node of the page, and look at it; return the node and its address."""
    web = ros.node('rpo_view', 'web', port=0)
    web.says('is shown at')
    url = re.search(r'http://127\.0\.0\.1:\d+/', web.output)[0]
    look(page, WIDTH, 'light')
    page.call('Page.navigate', url=url)
    return web, url


def approach(ros, scenario, factor):
    """Start all nodes of a scenario in one process."""
    ros.node(
        'rpo_bringup', 'final_approach', '--scenario', scenario, '--real-time-factor', factor,
        '--no-report', '--output', str(ros.folder / 'run'),
    )  # fmt: skip


def ink(page, canvas: str) -> int:
    """Return how many colours a canvas shows."""
    return page.evaluate(
        f'(() => {{ const c = document.getElementById("{canvas}"); '
        'const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data; '
        'const s = new Set(); for (let i = 0; i < d.length; i += 4) '
        's.add(d[i] * 65536 + d[i + 1] * 256 + d[i + 2]); return s.size; })()'
    )


@pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed')
def test_the_page_follows_a_flight(ros_env, tmp_path):
    pictures = Path(os.environ.get('RPO_PICTURES', tmp_path))
    with node_processes(ros_env, tmp_path) as ros, browser(CHROMIUM, tmp_path / 'profile') as page:
        web, url = opened(ros, page)
        until(page, 'typeof now !== "undefined" && now !== null')
        assert 'is a plant running' in page.evaluate('el("sentence").textContent')
        ros.node('rpo_bringup', *FLIGHT, '--output', str(tmp_path / 'run'))
        until(page, 'now.time_s > 62 && now.decisions.x && forces.length > 20')
        assert page.evaluate('el("sentence").textContent') == 'running: flying'
        who = f'scenario paper_test, controller {DEFAULT_CONTROLLER}'
        assert page.evaluate('el("who").textContent') == who
        assert page.evaluate('document.querySelectorAll("td[title^=strength]").length') >= 3
        for theme in ('light', 'dark'):
            look(page, WIDTH, theme)
            time.sleep(0.5)
            page.screenshot(pictures / f'live_{theme}.png')
            assert all(ink(page, canvas) > 5 for canvas in ('plane', 'side', 'strip', 'closing'))
        page.evaluate('el("close").click()')
        until(page, 'now.phase === "finished"')
        for width in (600, 390):  # a narrow window, a phone: one column, nothing wider than it
            look(page, width, 'light')
            time.sleep(0.5)
            assert page.evaluate('document.documentElement.scrollWidth') <= width
        assert web.stop() == 0
        until(page, 'stale')
        assert 'no connection to the server' in page.evaluate('el("sentence").textContent')
        assert all(request.startswith((url, 'data:')) for request in page.requests)
        # Not the page's: the server that ended, and this test's looking at the canvases.
        own = [m for m in page.messages if 'ERR_' not in m and 'Canvas2D' not in m]
        assert not own, own


@pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed')
def test_the_page_shows_zones_and_how_the_chaser_turns(ros_env, tmp_path):
    with node_processes(ros_env, tmp_path) as ros, browser(CHROMIUM, tmp_path / 'profile') as page:
        opened(ros, page)
        approach(ros, 'tumbling_docking', '10')
        until(page, 'typeof now !== "undefined" && now && now.time_s > 20 && now.docking_axis')
        assert page.evaluate('Math.abs(Math.hypot(...now.docking_axis) - 1) < 1e-9')
        assert page.evaluate('!el("axis-legend").hidden && el("has-pulses").hidden')
        assert page.evaluate('!el("zone-legend").hidden && now.zones.length') > 0
        assert not [m for m in page.messages if 'ERR_' not in m and 'Canvas2D' not in m]
