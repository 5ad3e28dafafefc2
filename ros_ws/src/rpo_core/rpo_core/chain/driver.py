# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The driver: flies the stages of a chain tick by tick, kernel after kernel. It knows no stage.

All signals stand in one flat array, laid out from the links of the chain. A stage without a kernel
is called as Python, at its place in the tick.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.chain import NO_FORCE, Chain, Link, Signals
from rpo_core.kernels import calls
from rpo_core.kernels.jit import COMPILED, as_table
from rpo_core.stage import has_kernel, width_of
from rpo_core.wire.interfaces import NEXT, current


class Driver:
    """A chain that is flown.

    places : signal -> its slice of the flat array
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        made = dict.fromkeys((*chain.outputs, *(n for n in chain.inputs if current(n) == n)))
        reads = (name for link in chain.links for name in link.reads)
        earlier = list(dict.fromkeys(name for name in reads if current(name) != name))
        self.places: dict[str, slice] = {}
        self._size = self._width = 0
        for name in (*made, *earlier, NO_FORCE):
            end = self._size + (width_of(current(name)) if name else 3)
            self.places[name] = slice(self._size, end)
            self._size = end
            self._width = end if name in made else self._width
        self._before = self._of(name for name in made if name in NEXT)
        self._after = self._of(name for name in made if name not in NEXT)
        carried = [name for name in earlier if current(name) in made]
        sources = self._of(map(current, carried))
        self._carried = list(zip(sources, self._of(carried), strict=True))
        self._reads: list[int] = []
        self._rows = [self._row(link) for link in chain.links]

    def _of(self, names: Iterable[str]) -> list[int]:
        """Return the places of signals."""
        return [i for n in names for i in range(self.places[n].start, self.places[n].stop)]

    def _row(self, link: Link) -> tuple[int, ...]:
        """Return what a stage reads and writes as `calls.run` reads it."""
        first = len(self._reads)
        self._reads += self._of(link.reads)
        writes = [self.places[name] for name in link.stage.outputs]
        size = writes[-1].stop - writes[0].start if has_kernel(link.stage) else 0
        return first, len(self._reads) - first, writes[0].start, size

    def fly(self, start: Signals, ticks: int) -> dict[str, NDArray[np.float64]]:
        """Fly ticks 0 to `ticks`; return the signals (ticks + 1, width) that the stages make."""
        self.begin(start, ticks)
        while (asked := self.go_on()) is not None:
            tick, index = asked
            self._step(tick, index)
            self.at[1] += 1
        return self.flown()

    def begin(self, start: Signals, ticks: int) -> None:
        """Begin a flight of ticks 0 to `ticks`: each stage forgets, signals are those of tick 0.

        at : (2,) tick, and stage of it, where the flight stands
        signals : flat, those of this tick; `places` says where
        """
        self.chain.reset()
        flat = np.zeros(self._size)
        for name, values in start.items():
            flat[self.places[name]] = values
        log = as_table(np.empty((ticks + 1, self._width)))
        tables: tuple[Any, ...] = (
            (0, 0), self._reads, np.array(self._carried).reshape(-1, 2), self._before, self._after
        )  # fmt: skip
        self.at, reads, carried, before, after = (as_table(table, np.int64) for table in tables)
        stages = [link.stage for link in self.chain.links]  # interpreted, memory is made anew
        rows: Any = [
            (*(stage.row if has_kernel(stage) else (0, 0, 0)), *row)
            for stage, row in zip(stages, self._rows, strict=True)
        ]
        rows = np.array(rows, np.int64) if COMPILED else rows
        self._u = as_table([0.0] * (1 + max(row[1] for row in self._rows)))
        self.signals, self._log = as_table(flat), log
        self._flight = (
            self.at, ticks, rows, reads, self.signals, self._u, carried, log, before, after
        )  # fmt: skip

    def go_on(self) -> tuple[int, int] | None:
        """Fly on to the end, None; or to a stage without a kernel: its tick and its number.

        Who steps that writes what it makes into `signals`, and adds 1 to `at[1]`. RuntimeError says
        which stage failed, at which tick.
        """
        while self._asked():
            tick, index = (int(value) for value in self.at)
            stage = self.chain.links[index].stage
            if not has_kernel(stage):
                return tick, index
            stage.answer(tick, self._u)
        return None

    def flown(self) -> dict[str, NDArray[np.float64]]:
        """Return the signals (ticks + 1, width) of the flight that the stages make."""
        kept = np.asarray(self._log)
        return {name: kept[:, self.places[name]] for name in self.chain.outputs}

    def _asked(self) -> int:
        """Fly on; return whether a stage is asked, and say which one failed at which tick."""
        try:
            asked: int = calls.run(*self._flight)
        except Exception as error:
            tick, index = (int(value) for value in self.at)
            name = self.chain.links[index].stage.name
            raise RuntimeError(f'stage `{name}` failed at tick {tick}: {error}') from error
        return asked

    def _step(self, tick: int, index: int) -> None:
        """Step a stage that has no kernel."""
        link, signals = self.chain.links[index], self.signals
        read = [tuple(float(v) for v in signals[self.places[name]]) for name in link.reads]
        outputs = link.stage.step(tick, *read)
        for name, values in zip(link.stage.outputs, outputs, strict=True):
            place = self.places[name]
            for i, value in zip(range(place.start, place.stop), values, strict=True):
                signals[i] = value
