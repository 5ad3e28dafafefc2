# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs in which a second controller took part: which command is whose.

The recorder attaches each further controller file of a run as controller-2.yaml and so on. A
command is as computed if one of these controllers computes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.chain import Chain
from rpo_core.chain.stage import Place
from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario
from rpo_log.format.run import CONTROLLER, is_controller
from rpo_log.read.decode import TickBlock
from rpo_log.read.run_log import controller_of
from rpo_log.read.stream import RunReader
from rpo_log.verify.decisions import Decisions
from rpo_log.verify.recomputation import Floats, Recomputation

Made = tuple[list[Floats], NDArray[np.bool_]]
"""Outputs of a stage at some ticks, and where they are known."""


class Controllers:
    """The controllers of a run, each recomputed; the first is that of controller.yaml.

    first : None if the log carries none: no command is then recomputed
    decisions : beside the log; they may be those of any controller
    """

    def __init__(
        self,
        reader: RunReader,
        scenario: Scenario,
        first: AnyController | None,
        decisions: Decisions | None,
    ) -> None:
        self._decisions = decisions
        self._reader, self._scenario = reader, scenario
        self._files = [CONTROLLER]
        self._names = [first.name if first else '']
        self._ticks = [0]
        self._more: list[tuple[Recomputation, Sequence[str]]] = []
        self._owner = 0

    @property
    def shares(self) -> tuple[str, ...]:
        """Per controller its name, file and number of commands; empty if there is only one."""
        if not self._more:
            return ()
        return tuple(
            f'{name} ({file}) at {ticks} ticks'
            for name, file, ticks in zip(self._names, self._files, self._ticks, strict=True)
        )

    def _find(self) -> None:
        """Take the files that were attached since."""
        for file in sorted(self._reader.attachments):
            if is_controller(file) and file not in self._files:
                found = controller_of(self._reader, file)
                (link,) = Chain.of(self._scenario, found).part(Place.CONTROLLER).links
                if self._decisions is not None:
                    self._decisions.add(found, self._reader.attachments[file])
                self._files.append(file)
                self._names.append(found.name)
                self._ticks.append(0)
                self._more.append((Recomputation(link.stage), link.reads))

    def any_of(
        self,
        block: TickBlock,
        output: str,
        first: Made,
        run: Callable[[Recomputation, Sequence[str]], Made],
        active: NDArray[np.bool_],
    ) -> Made:
        """Return the commands as computed by the controller that made them.

        output : name of the command
        first : as the first controller computes them
        run : recomputes another one, with the signals that it reads
        active : where the controllers are switched on
        """
        self._find()
        if not self._more:
            return first
        logged = block.values[output]
        equal = [_equal(logged, first)]
        equal += [_equal(logged, run(stage, reads)) for stage, reads in self._more]
        for row in np.flatnonzero(active & block.present[output]).tolist():
            owners = [number for number, found in enumerate(equal) if found[row]]
            if owners:
                self._owner = self._owner if self._owner in owners else owners[0]
                self._ticks[self._owner] += 1
        known = np.logical_or.reduce(equal)
        (made,), first_known = first
        return [np.where(known[:, None], logged, made)], known | first_known


def _equal(logged: Floats, computed: Made) -> NDArray[np.bool_]:
    """Return where a command has the bits that are computed."""
    (made,), known = computed
    bits = [np.ascontiguousarray(values).view(np.uint64) for values in (logged, made)]
    same: NDArray[np.bool_] = known & (bits[0] == bits[1]).all(axis=1)
    return same
