# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One scenario in a run: the plant publishes it, all other nodes take it from there."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

from rpo_core import files, plugins
from rpo_core.files.validation import InputError, choice
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import sections
from rpo_core.wire.statuses import Manifest
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear

ANEW_S = 2.5
"""Silence of a plant, which publishes its manifest once a second, after which another may take
over; until then it is a second one, and does not count."""

SCENARIO_FILE = 'file.scenario.yaml'
_MODE = 'parameter.mode'
LOCKSTEP, FREE_RUNNING = 'lockstep', 'free_running'
"""Modes of a plant."""


class PlantScenario:
    """Reads the manifest of the plant, and compares its scenario with the parameter of the node.

    take : takes the scenario of the run; raises InputError if the node cannot take part
    refuse : gets the reason why the node cannot take part
    bare : whether to read it without sections, where no plug-in may have added one: what the node
        does depends on none
    free_running : whether the plant keeps the wall clock; then it publishes the forces that act
    scenario : of the run; the one of the parameter until the plant publishes its own; None: unknown
    """

    def __init__(
        self,
        node: FlightNode,
        asserted: str,
        take: Callable[[Scenario], Any],
        refuse: Callable[[str], Any],
        bare: bool = False,
    ) -> None:
        self._node, self._take, self._refuse = node, take, refuse
        self.bare = bare and not asserted and not os.environ.get(plugins.VARIABLE)
        if not self.bare:
            sections()  # imported now: in flight a node that imports for a second answers nobody
        self._asserted = scenario.load_scenario(asserted) if asserted else None
        self._asserted_text = ''
        if self._asserted is not None:
            content = files.read_text(files.find('scenario', asserted))
            self._asserted_text = scenario.text_for_logs(content, self._asserted)
        self._text = self._run = self._mode = ''
        self._heard_s = self._asked_s = 0.0
        self.scenario = self._asserted
        self.free_running = False
        hear(node, Manifest, self._on_manifest)

    def confirmed(self, patience_s: float) -> bool:
        """Return whether the plant has said what it flies, or has not said so for some time."""
        now_s = time.monotonic()
        self._asked_s = self._asked_s or now_s
        return bool(self._text) or now_s - self._asked_s > patience_s

    def begin(self) -> None:
        """Pass on the scenario of the parameter, if there is one; the node is ready."""
        if self.scenario is not None:
            self._take(self.scenario)

    def _on_manifest(self, manifest: Manifest) -> None:
        if manifest.role != 'plant':
            return
        text, mode = (manifest.values.get(key, '') for key in (SCENARIO_FILE, _MODE))
        run, now_s = manifest.run, time.monotonic()
        other = (text, mode) != (self._text, self._mode)
        heard = self._run != '' and now_s - self._heard_s < ANEW_S
        if other and (heard or self._run == run != ''):
            return  # while a plant is there, and within a run, neither changes
        flown = self._flown(text, mode) if other else None
        self._run, self._heard_s = run, now_s
        if flown is None:
            return
        self._text, self._mode = text, mode
        try:
            self._compare(flown)
            free = mode == FREE_RUNNING
            if flown != self.scenario or free != self.free_running:
                self.scenario, self.free_running = flown, free
                self._take(flown)
        except InputError as error:
            self._refuse(str(error))

    def _flown(self, text: str, mode: str) -> Scenario:
        """Return the scenario that a plant flies in a mode; raises InputError if no plant does."""

        def parse(document: Any) -> Any:
            if self.bare:  # to import and to check all of its sections takes time
                return scenario.parse(scenario.bare(document), known={})
            return scenario.parse(document, rehearsed=True)  # by the plant, as it read the file

        asserted = self._asserted if text == self._asserted_text else None
        flown = asserted or files.loads(text, parse, 'the scenario of the plant')
        if not isinstance(flown, Scenario):
            raise InputError('the scenario of the plant must be a single flight; got a set')
        choice(_MODE, mode, ('', LOCKSTEP, FREE_RUNNING))
        return flown

    def _compare(self, flown: Scenario) -> None:
        if self._asserted is not None and flown != self._asserted:
            same = ' with other content' if flown.name == self._asserted.name else ''
            raise InputError(
                f'`scenario` must be the one of the plant, {flown.name}; '
                f'got {self._asserted.name}{same}'
            )
