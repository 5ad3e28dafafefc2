# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Enforced security without the means for it: nothing starts, and a sentence says why."""

import pytest

from rpo_ros.running import LOOPBACK, PEERS, PROFILES, RANGE, keep_to_this_machine
from rpo_sim.plant_node import PlantNode

ENCLAVE = (
    'identity_ca.cert.pem', 'cert.pem', 'key.pem', 'permissions_ca.cert.pem', 'governance.p7s',
    'permissions.p7s',
)  # fmt: skip


@pytest.mark.parametrize('nonsense', [False, True])
def test_enforced_without_the_means_it_does_not_start(command, tmp_path, monkeypatch, nonsense):
    """Nonsense: refused by a middleware with security for it, by one without for being asked."""
    folder = tmp_path / 'keys' / 'enclaves'
    if nonsense:
        folder.mkdir(parents=True)
        for name in ENCLAVE:
            (folder / name).write_text('nonsense')
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(folder.parent))
    code, output = command(PlantNode.main)
    assert code == 2 and 'Traceback' not in output
    (said,) = [line for line in output.splitlines() if 'ROS 2 does not start' in line]
    assert 'ROS_SECURITY_ENABLE is set' in said
    assert nonsense or 'keys/enclaves' in said


@pytest.mark.parametrize(
    ('env', 'kept'),
    [
        ({RANGE: 'LOCALHOST'}, True),
        ({RANGE: 'LOCALHOST', PEERS: '', 'ROS_DISTRO': 'kilted'}, True),
        ({RANGE: 'LOCALHOST', PEERS: '10.77.0.2'}, False),
        ({RANGE: 'SUBNET'}, False),
        ({}, False),
        ({RANGE: 'LOCALHOST', PROFILES[0]: 'mine.xml'}, False),
    ],
)
def test_what_is_opened_to_nobody_keeps_to_this_machine(env, kept):
    before = dict(env)
    keep_to_this_machine(env)
    old = env.get('ROS_DISTRO') != 'kilted'
    assert env == ({**before, PROFILES[old]: str(LOOPBACK[old])} if kept else before)


def test_both_versions_of_the_middleware_keep_to_this_machine_alike():
    """Fast DDS 3 refused a whole profile for one name, and so listened everywhere."""
    new, old = (path.read_text() for path in LOOPBACK)
    assert new == old.replace('nackSupressionDuration', 'nack_supression_duration') != old
