# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The table of benchmarks: what it reads, how it is kept; the measuring itself is slow."""

import json
import os
import re
import subprocess
import time

import pytest
from invoking import invoke

from rpo.cli import bench

ROWS = [
    bench.Row('P1', 'inference', 2.0, '4/s', '1/s', 4.0),
    bench.Row('P2', 'training', 1.6, '2 s', '3 s', 1.5),
]


def test_the_page_keeps_its_text_and_has_the_last_table_and_every_run_is_kept(tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('# Speed\n\nBefore.\n')
    bench.saved(ROWS[1:], tmp_path / 'bench', page)
    page.write_text(page.read_text() + '\nAfter.\n')
    kept = json.loads(bench.saved(ROWS, tmp_path / 'bench', page).read_text())
    assert kept['rows'][1]['ratio'] == 1.5 and kept['machine']['processor']
    text = page.read_text()
    assert text.startswith('# Speed\n\nBefore.\n') and text.endswith('\nAfter.\n')
    assert text.count('| P1 | inference | ≥ 2 × | 4/s | 1/s | 4 × | held |') == 1
    assert text.count('| P2 | training | ≥ 1.6 × | 2 s | 3 s | 1.5 × | MISSED |') == 1


def test_a_stopped_benchmark_leaves_no_node(tmp_path, monkeypatch):
    node, began = tmp_path / 'lib' / 'rpo_bringup' / 'ping_pong', tmp_path / 'began'
    node.parent.mkdir(parents=True)
    node.write_text(f'#!/bin/sh\necho $$ > {began}.new; mv {began}.new {began}\nexec sleep 200\n')
    node.chmod(0o755)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    stopped = subprocess.Popen(['rpo', 'bench', 'ros'], stderr=subprocess.PIPE, text=True)
    while not began.exists():
        assert stopped.poll() is None
        time.sleep(0.02)
    stopped.terminate()
    assert 'Interrupted; its nodes have ended' in stopped.communicate()[1]
    assert stopped.returncode == 130
    with pytest.raises(ProcessLookupError):
        os.kill(int(began.read_text()), 0)


@pytest.mark.slow
def test_the_parts_are_measured_beside_their_peers():
    for words in ('inference', 'training --evaluations 60', 'campaign --runs 20', 'learning'):
        result = invoke('bench', *words.split())
        assert result.exit_code == 0, result.output
        assert re.search('held|MISSED', result.output)
