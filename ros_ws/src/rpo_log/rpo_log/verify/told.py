# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What stages said of their decisions on `stage_status`, beside what they decide again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rpo_core.wire import interfaces
from rpo_log import events
from rpo_log.read.decode import Event
from rpo_log.verify.difference import Difference
from rpo_log.verify.recomputation import Recomputation

LATE_TICKS = 50


class Told:
    """Keeps the decisions that a log tells of, and compares them when all is recomputed."""

    def __init__(self, stages: Sequence[Recomputation], topic: str) -> None:
        self._stages = {found.stage.name: found for found in stages if found.stage.decides}
        self._topic = topic
        self._logged: dict[str, list[tuple[int, str]]] = {name: [] for name in self._stages}

    def take(self, event: Event) -> None:
        """Take an event; those that are no decision of a stage here are no matter."""
        name, state = event.values.get('stage', ''), event.values.get('state', '')
        tick = events.tick_of(event.status)
        if event.signal != interfaces.STAGE_STATUS or name not in self._stages or tick is None:
            return
        if state in self._stages[name].stage.decides:
            self._logged[name].append((tick, state))

    def difference(self) -> Difference | None:
        """Return the first decision in the log that the stage does not make."""
        for name, found in self._stages.items():
            extra = Counter(self._logged[name]) - Counter(found.stage.told())
            if extra and not found.gaps:
                tick, state = min(extra)
                return Difference(tick, self._topic, 'state', state, 'nothing', name)
        return None

    def gaps(self, last: int) -> list[str]:
        """Return the decisions that the log does not tell of, for people.

        last : newest tick of the log; what is said right before it may come after it
        """
        found = []
        for name, stage in self._stages.items():
            missing = Counter(stage.stage.told()) - Counter(self._logged[name])
            tick, state = min(missing, default=(last, ''))
            if tick < last - LATE_TICKS and not stage.gaps:
                found.append(f'{self._topic} does not say that {name} is {state} from tick {tick}')
        return found
