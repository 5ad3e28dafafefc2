# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Writes one page per node: purpose, topics, parameters, failures, exit codes.

The site has them in `docs/nodes`; `python docs/hooks/node_pages.py docs/nodes` writes them alone.

Parameters come from the table of the node; for topics and services the node is started.
`node_cards.yaml` has what comes from neither.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import rclpy
import yaml
from rclpy.node import Node
from rclpy.qos import QoSProfile

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control import controller
from rpo_core.scenario import scenario
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import MOST_IN_ALL, READERS
from rpo_log.tools.record import record
from rpo_ros import qos
from rpo_ros.parameter_rows import ParameterRow, tables
from rpo_ros.running import FlightNode

INDEX, PROTOCOL, POLICY = 'index.md', 'protocol.md', 'sros2_policy.xml'
_LEFT_OUT = ('/rosout', '/parameter_events', '/tf')
"""Topics of every node, and a topic that not every machine has: its row comes from the card."""

_STOCK_SERVICES = ('parameter', 'get_type_description')
"""In the names of services that every node has, which the pages leave out."""

Outcomes = tuple[tuple[str, str], ...]
"""Event -> outcome."""

_WRITTEN = yaml.safe_load(Path(__file__).with_name('node_cards.yaml').read_text('utf-8'))

MEANINGS: dict[str, str] = {row.topic: row.meaning for row in interfaces.rows()}
MEANINGS |= _WRITTEN['meanings']
"""Topic or service -> what it carries or does."""

_CODES = {0: 'done, or ended by a signal', 2: 'a bad parameter or file'}


@dataclass(frozen=True)
class Card:
    """A node: its module, its start for the page, its failures.

    cls : name of its class in the module <executable>_node
    trial : parameters for its start by `node_pages`, to find its topics
    also : scenarios of other starts, whose topics it has too
    publishes_tf : it does where `tf2_msgs` is installed, which the ROS 2 wheels lack
    """

    package: str
    executable: str
    cls: str
    failures: Outcomes
    exit_codes: Mapping[int, str] = field(default_factory=lambda: _CODES)
    trial: Mapping[str, Any] = field(default_factory=dict)
    also: Sequence[str] = ()
    publishes_tf: bool = False

    @property
    def module(self) -> ModuleType:
        """The node's module."""
        return import_module(f'{self.package}.{self.executable}_node')

    @property
    def parameters(self) -> Sequence[ParameterRow]:
        """The node's table of parameters."""
        return tables(self.package)[self.executable]

    @property
    def command(self) -> str:
        """The command of the node."""
        return f'ros2 run {self.package} {self.executable}'


def _outcomes(rows: Sequence[Any]) -> Outcomes:
    """Return events and outcomes: pairs, and those that several nodes have, by their name."""
    found: list[tuple[str, str]] = []
    for row in rows:
        found += _outcomes(_WRITTEN['shared'][row]) if isinstance(row, str) else row.items()
    return tuple(found)


CARDS = tuple(
    Card(**{**card, 'failures': _outcomes(card['failures'])}) for card in _WRITTEN['nodes']
)
"""Every node of the stack."""

NAMES = (INDEX, PROTOCOL, POLICY, *(f'{card.executable}.md' for card in CARDS))
"""Files that are written."""


def tiny_log(folder: Path) -> Path:
    """Write a log of the scenario `quick`, for the nodes that need one."""
    quick = scenario.load_scenario('quick')
    flight = fly(quick, controller.load_controller(files.DEFAULT_CONTROLLER))
    record(flight, {}, folder)
    return folder


def _make(card: Card, more: Mapping[str, Any], folder: Path) -> FlightNode:
    """Start a node with the parameters of its card and more, in a folder of its own."""
    trial = {**card.trial, **more}
    if card.executable == 'recorder':
        trial['output'] = str(folder / 'recorded')
    if card.executable == 'replay':
        trial['bag'] = str(tiny_log(folder / 'log'))
    return getattr(card.module, card.cls)(trial)


def _qos(profile: QoSProfile) -> str:
    words = [profile.reliability.name, profile.durability.name]
    return f'{", ".join(words)}, last {profile.depth}'.lower().replace('_', ' ')


def _type(message: type) -> str:
    return f'{message.__module__.split(".")[0]}/{message.__name__}'


def _short(node: FlightNode, name: str) -> str:
    """Return a name as in the code: ~/ for the names of the node, else no leading slash."""
    own = f'{node.get_fully_qualified_name()}/'
    if name.startswith(own):
        return f'~/{name.removeprefix(own)}'
    absolute = ('/clock', '/diagnostics')
    return name if name in absolute else name.lstrip('/')


def _topics(node: FlightNode) -> Iterator[tuple[str, ...]]:
    heard = Node.subscriptions.fget(node)  # also those that a node keeps from its executor
    for way, ends in (('publishes', node.publishers), ('listens', heard)):
        found = {
            _short(node, end.topic_name): end for end in ends if end.topic_name not in _LEFT_OUT
        }
        for name, end in sorted(found.items()):
            kind = _type(end.msg_type)
            yield way, f'`{name}`', f'`{kind}`', _qos(end.qos_profile), MEANINGS[name]
    if hasattr(node, 'label'):  # rclpy hides the publisher of the lifecycle
        name = '~/transition_event'
        yield 'publishes', f'`{name}`', '`lifecycle_msgs/TransitionEvent`', '', MEANINGS[name]


def _services(node: FlightNode) -> Iterator[tuple[str, ...]]:
    """Yield the services; those that every node has are without a meaning."""
    for service in sorted(node.services, key=lambda service: service.service_name):
        name = _short(node, service.service_name)
        stock = any(word in name for word in _STOCK_SERVICES)
        yield f'`{name}`', f'`{_type(service.srv_type)}`', '' if stock else MEANINGS[name]


def _parameters(rows: Sequence[ParameterRow]) -> Iterator[tuple[str, ...]]:
    for row in rows:
        flight = 'may change' if row.changeable else 'fixed'
        yield f'`{row.name}`', row.kind, row.shown_default, row.range, flight, row.description


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[str]:
    lines = [head, ['---'] * len(head), *rows]
    return [f'| {" | ".join(str(cell).replace("|", chr(92) + "|") for cell in r)} |' for r in lines]


Found = tuple[list[tuple[str, ...]], list[tuple[str, ...]]]
"""Rows of the topics and of the services of a node."""


def _found(card: Card, folder: Path) -> Found:
    """Start a node; rclpy must be initialised."""
    found: dict[tuple[str, ...], tuple[str, ...]] = {}
    for more in ({}, *({'scenario': name} for name in card.also)):
        node = _make(card, more, folder)
        try:
            found |= {row[:2]: row for row in _topics(node)}
            services = list(_services(node))
        finally:
            node.close()
            node.destroy_node()
    topics = list(found.values())
    if card.also:
        topics.sort(key=lambda row: (row[0] == 'listens', row[1]))
    if card.publishes_tf:
        row = ('`/tf`', '`tf2_msgs/TFMessage`', _qos(qos.TF), MEANINGS['/tf'])
        topics.insert(0, ('publishes', *row))
    return topics, services


def page(card: Card, found: Found) -> str:
    """Return the page of a node as Markdown."""
    purpose = (card.module.__doc__ or '').strip().split(': ', 1)[-1]
    rows = card.parameters
    topics, services = found[0], [row for row in found[1] if row[-1]]
    example = f'{card.command} --ros-args -p {rows[0].name}:={rows[0].example}'
    lines = [f'# {card.executable}', '', purpose[:1].upper() + purpose[1:], '']
    lines += ['```sh', card.command, example, '```', '', '## Topics', '']
    lines += _table(['', 'topic', 'type', 'quality of service', 'content'], topics)
    if services:
        lines += ['', '## Services', '', *_table(['service', 'type', 'effect'], services)]
    lines += ['', '## Parameters', '']
    head = ['name', 'kind', 'default', 'allowed', 'in flight', 'meaning']
    lines += _table(head, list(_parameters(rows)))
    lines += ['', '## When something is wrong', '', *_table(['event', 'outcome'], card.failures)]
    codes = list(card.exit_codes.items())
    lines += ['', '## Exit codes', '', *_table(['code', 'meaning'], codes), '']
    return '\n'.join(lines)


def policy(nodes: Mapping[str, Found]) -> str:
    """Return a policy for SROS2: an enclave for each node, which may do what it does."""
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for node, (topics, services) in nodes.items():
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'/{node}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        profile = ElementTree.SubElement(profiles, 'profile', ns='/', node=node)
        made, heard = (
            [row[1].strip('`') for row in topics if row[0] == way]
            for way in ('publishes', 'listens')
        )
        offered = sorted(row[0].strip('`') for row in services)
        for kind, way, names_of in (
            ('topic', 'publish', [*made, 'rosout', 'parameter_events']),
            ('topic', 'subscribe', heard), ('service', 'reply', offered),
        ):  # fmt: skip
            parent = ElementTree.SubElement(profile, f'{kind}s', {way: 'ALLOW'})
            for name in names_of:
                ElementTree.SubElement(parent, kind).text = name.removeprefix('/')
            if not names_of:
                profile.remove(parent)
    ElementTree.indent(root)
    return ElementTree.tostring(root, 'unicode', xml_declaration=True) + '\n'


def protocol() -> str:
    """Return the page of what nodes say of a run: the contract of each status topic."""
    text = (
        'Each is a `diagnostic_msgs/DiagnosticStatus`: pairs of key and text, hardware id `none`. '
        'A node refuses a status with a wrong value as a whole, and counts it; a status has at '
        f'most {MOST_IN_ALL} characters, but for a manifest.'
    )
    lines = ['# What nodes say of a run', '', text, '']
    for row in interfaces.rows():
        if row.name not in READERS:
            continue
        found = READERS[row.name].contract
        lines += [f'## {row.name}', '', *_table(['', ''], [
            ('sent by', found.sender), ('when', found.when), ('who hears it', found.peer),
            ('level', found.level), ('quality of service', _qos(qos.of(row.qos))),
        ]), '']  # fmt: skip
        keys = [
            (f'`{key.name}`', key.kind.words, key.unit, '' if key.needed else 'optional',
             key.meaning)
            for key in found.keys
        ]  # fmt: skip
        lines += [*_table(['key', 'text', 'unit', '', 'meaning'], keys), '']
    return '\n'.join(lines)


def _index() -> str:
    rows = [
        (f'[{c.executable}]({c.executable}.md)', f'`{c.command}`',
         (c.module.__doc__ or '').strip().splitlines()[0].split(': ', 1)[-1])
        for c in CARDS
    ]  # fmt: skip
    text = f'[What nodes say of a run]({PROTOCOL}) is the contract of their statuses,'
    text += f' [{POLICY}]({POLICY}) a sample policy for [SROS2](../faults.md#access-control).'
    return '\n'.join(['# Nodes', '', text, '', *_table(['node', 'command', 'purpose'], rows), ''])


def pages() -> dict[str, str]:
    """Return file name -> page of every node, and an index."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    found = {INDEX: _index(), PROTOCOL: protocol()}
    nodes: dict[str, Found] = {}
    rclpy.init(args=None)
    try:
        for card in CARDS:
            with tempfile.TemporaryDirectory() as folder:
                rows = nodes[card.executable] = _found(card, Path(folder))
            found[f'{card.executable}.md'] = page(card, rows)
    finally:
        rclpy.try_shutdown()
    return found | {POLICY: policy(nodes)}


def main() -> int:
    """Write the pages into the folder that is named."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        path = folder / name
        if not path.is_file() or path.read_text('utf-8') != text:  # `mkdocs serve` watches it
            path.write_text(text, encoding='utf-8')
    print(f'{len(CARDS)} pages in {folder}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
