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

    places : signal -> its slice of the flat array, of the last stage that writes it
    spent : what its thrusters spent up to the last state (`Stage.spent`)
    """

    spent: tuple[float, float, int] | None = None

    def __init__(self, chain: Chain) -> None:
        self.chain, self._size = chain, 0
        outputs = [link.stage.outputs for link in chain.links]
        written = [{name: self._place(name) for name in names} for names in outputs]
        self.places = {name: place for block in written for name, place in block.items()}
        for name in chain.inputs:
            if current(name) == name and name not in self.places:
                self.places[name] = self._place(name)
        made, self._width = list(self.places), self._size
        reads = (name for link in chain.links for name in link.reads)
        earlier = list(dict.fromkeys(name for name in reads if current(name) != name))
        self.places |= {name: self._place(name) for name in (*earlier, NO_FORCE)}
        self._before = self._of(name for name in made if name in NEXT)
        self._after = self._of(name for name in made if name not in NEXT)
        carried = [name for name in earlier if current(name) in made]
        sources = self._of(map(current, carried))
        self._carried = list(zip(sources, self._of(carried), strict=True))
        standing = dict(self.places)  # where a stage reads a signal that several write
        self._links = []
        for link, block in zip(chain.links, written, strict=True):
            self._links.append(([standing[name] for name in link.reads], [*block.values()]))
            standing |= block
        self._reads: list[int] = []
        self._rows = [
            self._row(link, *places) for link, places in zip(chain.links, self._links, strict=True)
        ]

    def _place(self, name: str) -> slice:
        """Return room for a signal after those that have some."""
        first, self._size = self._size, self._size + (width_of(current(name)) if name else 3)
        return slice(first, self._size)

    def _of(self, names: Iterable[str]) -> list[int]:
        """Return the places of signals."""
        return _each(self.places[name] for name in names)

    def _row(self, link: Link, reads: list[slice], writes: list[slice]) -> tuple[int, ...]:
        """Return what a stage reads and writes as `calls.run` reads it."""
        first = len(self._reads)
        self._reads += _each(reads)
        size = writes[-1].stop - writes[0].start if has_kernel(link.stage) else 0
        return first, len(self._reads) - first, writes[0].start, size

    def fly(self, start: Signals, ticks: int) -> dict[str, NDArray[np.float64]]:
        """Fly ticks 0 to `ticks`; return the signals (ticks + 1, width) that the stages make."""
        self.begin(start, ticks)
        for self._last in (ticks - 1, ticks):
            while (asked := self.go_on()) is not None:
                self._step(*asked)
                self.at[1] += 1
            if self._last < ticks:
                totals = (link.stage.spent() for link in self.chain.links)
                self.spent = next((total for total in totals if total is not None), None)
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
        self._last, self._flight = ticks, (
            rows, reads, self.signals, self._u, carried, log, before, after
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
            asked: int = calls.run(self.at, self._last, *self._flight)
        except Exception as error:
            tick, index = (int(value) for value in self.at)
            name = self.chain.links[index].stage.name
            raise RuntimeError(f'stage `{name}` failed at tick {tick}: {error}') from error
        return asked

    def _step(self, tick: int, index: int) -> None:
        """Step a stage that has no kernel."""
        stage, (reads, writes) = self.chain.links[index].stage, self._links[index]
        outputs = stage.step(tick, *(tuple(map(float, self.signals[place])) for place in reads))
        for place, values in zip(writes, outputs, strict=True):
            for i, value in zip(range(place.start, place.stop), values, strict=True):
                self.signals[i] = value


def _each(places: Iterable[slice]) -> list[int]:
    return [i for place in places for i in range(place.start, place.stop)]
