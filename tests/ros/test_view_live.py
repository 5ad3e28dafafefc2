# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The page in a browser while real nodes fly.

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

CHROMIUM = shutil.which('chromium')
DEADLINE_S = 120.0
WIDTH = 1180
CARD = '(document.getElementById("card")?.textContent ?? "")'
DRAWS = 'typeof replay !== "undefined" && replay.stats.frames > 1'

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed'),
]


def look(page, width: int, theme: str) -> None:
    """Set the window's width and the reader's theme."""
    page.call(
        'Emulation.setDeviceMetricsOverride',
        width=width, height=760, deviceScaleFactor=1, mobile=False,
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
    web = ros.node('rpo_bringup', 'web', port=0)
    web.says('is shown at')
    url = re.search(r'http://127\.0\.0\.1:\d+/', web.output)[0]
    look(page, WIDTH, 'light')
    page.call('Page.navigate', url=url)
    return web, url


def approach(ros, scenario, factor):
    """Start all nodes of a scenario in one process."""
    return ros.node(
        'rpo_bringup', 'final_approach', '--scenario', scenario, '--real-time-factor', factor,
        '--no-report', '--output', str(ros.folder / 'run'),
    )  # fmt: skip


def complaints(page) -> list[str]:
    """Return what the page said, but for a server that ended and the driver of the picture."""
    return [m for m in page.messages if 'ERR_' not in m and 'GL Driver' not in m]


def test_the_page_waits_follows_a_flight_and_says_its_end(ros_env, tmp_path):
    pictures = Path(os.environ.get('RPO_PICTURES', tmp_path))
    with node_processes(ros_env, tmp_path) as ros, browser(CHROMIUM, tmp_path / 'profile') as page:
        web, url = opened(ros, page)
        until(page, f'{CARD}.includes("is a plant running")')
        flight = approach(ros, 'docking', '10')
        until(page, f'{DRAWS} && replay.now > 60')
        assert page.evaluate('el("verdict").textContent') == 'running: flying'
        assert page.evaluate('el("card").hidden && chosen.end === replay.now')
        assert page.evaluate('el("said").textContent').startswith('Phase to the port')
        assert page.evaluate('el("axes").textContent.includes("because")')
        for theme in ('light', 'dark'):
            look(page, WIDTH, theme)
            time.sleep(0.5)
            page.screenshot(pictures / f'live_{theme}.png')
        page.evaluate('replay.seek(20)')
        newest = page.evaluate('chosen.end')
        until(page, f'chosen.end > {newest} + 5')
        assert page.evaluate('replay.now') == 20.0, 'who looks back is left there'
        page.evaluate('replay.seek(1e9)')
        for width in (600, 390):  # a narrow window, a phone: one column, nothing wider than it
            look(page, width, 'light')
            time.sleep(0.5)
            assert page.evaluate('document.documentElement.scrollWidth') <= width
        flight.stop()
        until(page, f'{CARD}.startsWith("Aborted: interrupted")')
        assert web.stop() == 0
        until(page, f'{CARD}.includes("No connection to the server")')
        assert all(request.startswith((url, 'data:', 'blob:')) for request in page.requests)
        assert not complaints(page)


def test_the_page_shows_how_the_chaser_turns(ros_env, tmp_path):
    with node_processes(ros_env, tmp_path) as ros, browser(CHROMIUM, tmp_path / 'profile') as page:
        opened(ros, page)
        approach(ros, 'tumbling_docking', '10')
        until(page, f'{DRAWS} && replay.now > 20')
        assert page.evaluate('chosen.turns.map(t => t[0]).join()') == 'off reference,turn rate'
        assert page.evaluate('el("said").textContent.includes("The estimate is off by")')
        assert page.evaluate('docking.visible && cloud.visible && ghost.visible')
        assert not complaints(page)
