# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks end with their nodes; the measuring itself is slow."""

import os
import re
import subprocess
import time

import pytest
from invoking import invoke


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
