# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Enforced security without the means for it: nothing starts, and a sentence says why."""

import pytest

from rpo_ros.running import LOOPBACK, PEERS, PROFILES, RANGE, keep_to_this_machine
from tools.node_processes import node_processes

ENFORCED = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}
ENCLAVE = (
    'identity_ca.cert.pem', 'cert.pem', 'key.pem', 'permissions_ca.cert.pem', 'governance.p7s',
    'permissions.p7s',
)  # fmt: skip


@pytest.fixture
def ros(ros_env, tmp_path):
    with node_processes({**ros_env, **ENFORCED}, tmp_path) as started:
        yield started


def refused(node):
    """Return the one sentence of a node that does not start."""
    assert node.wait() == 2, node.output
    assert 'Traceback' not in node.output
    lines = [line for line in node.output.splitlines() if 'ROS 2 does not start' in line]
    assert len(lines) == 1, node.output
    return lines[0]


def test_no_keystore(ros):
    ros.env['ROS_SECURITY_KEYSTORE'] = str(ros.folder / 'nowhere')
    said = refused(ros.node('rpo_sim', 'plant'))
    assert 'nowhere/enclaves' in said
    assert 'ROS_SECURITY_ENABLE is set' in said


def test_an_enclave_of_nonsense(ros):
    """Refused by a middleware with security for its content, by one without for being asked."""
    folder = ros.folder / 'keys' / 'enclaves'
    folder.mkdir(parents=True)
    for name in ENCLAVE:
        (folder / name).write_text('nonsense')
    ros.env['ROS_SECURITY_KEYSTORE'] = str(ros.folder / 'keys')
    refused(ros.node('rpo_sim', 'plant'))


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
