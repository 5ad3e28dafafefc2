# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The manifests of a run's nodes, as the recorder attaches them: their files and parameters."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import yaml

from rpo_core import files
from rpo_core.chain.chain import signals_of
from rpo_core.control import controller
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import sections
from rpo_core.wire import interfaces
from rpo_log.format import run
from rpo_log.topics import Topic

PLANT, CONTROLLER, DISTURBANCE = 'plant', 'controller', 'disturbance'

_BY_SCENARIO = frozenset(
    (interfaces.NAVIGATION_STATE, interfaces.CONTROL_FORCE, interfaces.DISTURBANCE_FORCE)
)
"""Signals whose nodes may be there in a run that does not need them."""

_ROLES = (PLANT, CONTROLLER, DISTURBANCE)

_FILE, _PARAMETER, _RUN = 'file.', 'parameter.', 'run'
PUBLISHES, HEARS = 'publishes.', 'hears.'
_OWNERS = {run.SCENARIO: PLANT, run.CONTROLLER: CONTROLLER}
"""Files that one role alone may bring."""
_FILE_NAME = re.compile(r'[A-Za-z0-9_.-]{1,80}')
_MOST_ROLES = 32
_MOST_TEXT = 1000

Values = Mapping[str, str]


class Manifests:
    """The manifests heard so far; the first usable one of a plant is that of the run.

    scenario : of the run; None until its plant is known
    """

    def __init__(self) -> None:
        sections()  # imported now: in flight a node that imports for a second hears nobody
        self.scenario: Scenario | None = None
        self._by_role: dict[str, tuple[str, Values]] = {}
        self._attached: list[str] = []

    @property
    def run_id(self) -> str:
        """Id of the plant; '' if it gives none."""
        return self._value(PLANT, _RUN)

    def _value(self, role: str, key: str) -> str:
        return self._by_role.get(role, ('', {}))[1].get(key, '')

    def take(self, name: str, values: Values) -> str:
        """Take the manifest of a node; return why it is not one of this run, '' if it is."""
        role = values.get('role', '')
        if role == PLANT:
            return self._take_plant(name, values)
        if role not in self._by_role and len(self._by_role) >= _MOST_ROLES:
            return f'{name} has a role too many'
        text = values.get(_FILE + run.CONTROLLER, '')
        is_ours = role != CONTROLLER or not self._attached or text in self._attached
        if not is_ours and not _is_controller(text):
            return f'{name} has no usable controller file'
        self._by_role[role] = (name, values)
        return ''

    def _take_plant(self, name: str, values: Values) -> str:
        if self.scenario is not None:
            ours = values.get(_RUN, '') == self.run_id
            return '' if ours else f'{name} is a second plant: the log is that of the first'
        try:
            text = values[_FILE + run.SCENARIO]
            flown = files.loads(text, partial(scenario.parse, rehearsed=True), 'scenario')
        except (InputError, KeyError) as error:
            return f'the manifest of {name} has no usable scenario: {error}'
        if not isinstance(flown, Scenario):
            return f'the manifest of {name} has a set of scenarios'
        self.scenario = flown
        self._by_role[PLANT] = (name, values)
        return ''

    def another_controller(self) -> tuple[str, bytes] | None:
        """Return name and text of a controller file that is not attached yet; None: there is none.

        It is then attached: whoever asks writes it to the log.
        """
        text = self._value(CONTROLLER, _FILE + run.CONTROLLER)
        if not text or text in self._attached or len(self._attached) >= run.MOST_CONTROLLERS:
            return None
        self._attached.append(text)
        return run.controller_name(len(self._attached)), text.encode()

    @property
    def missing(self) -> list[str]:
        """The roles without a manifest that a log needs first."""
        if self.scenario is None:
            return [PLANT]
        roles = [CONTROLLER] if self.scenario.disturbance.is_zero else [CONTROLLER, DISTURBANCE]
        return [role for role in roles if role not in self._by_role]

    def topic_of(self, signal: str) -> str:
        """Return where the run has a signal: at the plant, else at its publisher; '' if unsaid."""
        keys = [(PLANT, HEARS), (PLANT, PUBLISHES), *((role, PUBLISHES) for role in self._by_role)]
        return next(filter(None, (self._value(role, kind + signal) for role, kind in keys)), '')

    def due_each_tick(
        self, flown: Scenario, publishers: Callable[[interfaces.Interface], int]
    ) -> list[interfaces.Interface]:
        """Return the rows of the topics with a message at every tick.

        They are those of the scenario's stages; and any other that a node publishes, unless the
        scenario alone decides about it.

        publishers : returns how many publish a topic
        """
        made = {*signals_of(flown)}
        for row in interfaces.rows(logged=True):
            if row.due == interfaces.EACH_TICK and row.name not in _BY_SCENARIO:
                made |= {row.name} if publishers(row) else set()
        if self._value(PLANT, f'{_PARAMETER}publish_clock') == 'True':
            made.add(interfaces.CLOCK)
        if self._value(PLANT, f'{_PARAMETER}mode') == 'free_running':
            turns = interfaces.BODY_FORCE in made
            made.add(interfaces.APPLIED_BODY_FORCE if turns else interfaces.APPLIED_FORCE)
            if not flown.disturbance.is_zero:
                made.add(interfaces.APPLIED_DISTURBANCE)
        return [row for row in interfaces.rows(logged=True) if row.name in made]

    def remaps(self, recorded: Iterable[Topic]) -> dict[str, bytes]:
        """Return the file of nodes that hear a signal where it is not recorded; {}: none does."""
        where = {topic.signal: topic.name for topic in recorded}
        remaps = {}
        for name, values in self._by_role.values():
            heard = {key[len(HEARS) :]: t for key, t in values.items() if key.startswith(HEARS)}
            if any(where.get(signal, topic) != topic for signal, topic in heard.items()):
                topics = {k: t for k, t in values.items() if k.startswith((HEARS, PUBLISHES))}
                remaps[name] = topics
        return {run.TOPICS: yaml.safe_dump(remaps, sort_keys=True).encode()} if remaps else {}

    def attachments(self, recorder: Mapping[str, Any]) -> dict[str, bytes]:
        """Return what the nodes run with: their files, and a file of all their parameters.

        recorder : parameters of the recorder
        """
        attached: dict[str, bytes] = {}
        parameters: dict[str, dict[str, Any]] = {'recorder': dict(recorder)}
        for role, (name, values) in self._by_role.items():
            node = {}
            for key, text in values.items():
                kind, _, what = key.partition('.')
                if kind == 'file' and _may_bring(role, what):
                    attached[what] = text.encode()
                elif kind == 'parameter':
                    node[what] = _parsed(text)
            if node or role in _ROLES:
                parameters.setdefault(name, node)
        if run.CONTROLLER in attached:
            self._attached.append(attached[run.CONTROLLER].decode())
        attached[run.PARAMETERS] = yaml.safe_dump(parameters, sort_keys=True).encode()
        return attached


def _is_controller(text: str) -> bool:
    try:
        files.loads(text, controller.parse, 'controller')
    except InputError:
        return False
    return True


def _may_bring(role: str, file: str) -> bool:
    reserved = file in (run.PARAMETERS, run.TOPICS, run.DIFFERING) or (
        run.is_controller(file) and file != run.CONTROLLER
    )
    allowed = _OWNERS.get(file, role) == role and not reserved
    return allowed and _FILE_NAME.fullmatch(file) is not None


def _parsed(text: str) -> Any:
    """Return the value of a parameter in a manifest; the text itself where it is no YAML."""
    try:
        return files.parse_yaml(text) if len(text) <= _MOST_TEXT else text
    except InputError:
        return text
