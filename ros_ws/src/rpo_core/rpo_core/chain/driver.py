# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The driver: flies the stages of a chain tick by tick, kernel after kernel. It knows no stage.

All signals stand in one flat array, laid out from the links of the chain. A stage without a kernel
is called as Python, at its place in the tick.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.chain import NO_FORCE, Chain, Link, Signals
from rpo_core.kernels import calls
from rpo_core.kernels.jit import COMPILED, as_table
from rpo_core.stage import has_kernel, places_of, stand_together, width_of
from rpo_core.wire.interfaces import NEXT, current


class Driver:
    """A chain that is flown.

    kept : signals of each tick that a flight keeps; None: all that its stages make
    places : signal -> its slice of the flat array, of the last stage that writes it
    spent : what its thrusters spent up to the last state (`Stage.spent`)
    """

    spent: tuple[float, float, int] | None = None

    def __init__(self, chain: Chain, kept: Collection[str] | None = None) -> None:
        self.chain, self._size = chain, 0
        outputs = [link.stage.outputs for link in chain.links]
        written = [{name: self._place(name) for name in names} for names in outputs]
        self.places = {name: place for block in written for name, place in block.items()}
        for name in chain.inputs:
            if current(name) == name and name not in self.places:
                self.places[name] = self._place(name)
        made = list(self.places)
        reads = [name for link in chain.links for name in link.reads]
        earlier = list(dict.fromkeys(name for name in reads if current(name) != name))
        self.places |= {name: self._place(name) for name in (*earlier, NO_FORCE)}
        self._kept = [n for n in dict.fromkeys(chain.outputs) if kept is None or n in kept]
        unread = {*chain.outputs}.difference(map(current, reads), self._kept)
        for link in chain.links:
            link.stage.take_unread(unread)
        self._before = self._of(name for name in self._kept if name in NEXT)
        self._after = self._of(name for name in self._kept if name not in NEXT)
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
                self.step_in(self.signals, *asked)
                self.at[1] += 1
            if self._last < ticks:
                self.spend()
        return self.flown()

    def spend(self) -> None:
        """Keep what is spent so far."""
        totals = (link.stage.spent() for link in self.chain.links)
        self.spent = next((total for total in totals if total is not None), None)

    def room(self, ticks: int, *flights: int) -> NDArray[np.float64]:
        """Return room for what is kept of ticks 0 to `ticks`, of one flight or several."""
        return np.empty((*flights, ticks + 1, len(self._before) + len(self._after)))

    def begin(self, start: Signals, ticks: int, room: NDArray[np.float64] | None = None) -> None:
        """Begin a flight of ticks 0 to `ticks`: each stage forgets, signals are those of tick 0.

        room : for what is kept; None: it is made

        at : (2,) tick, and stage of it, where the flight stands
        flight : what `calls.run` takes, from its rows on
        signals : flat, those of this tick; `places` says where
        """
        self.chain.reset()
        flat = np.zeros(self._size)
        for name, values in start.items():
            flat[self.places[name]] = values
        log = as_table(self.room(ticks)) if room is None else room
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
        self._last, self.flight = ticks, (
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
        return self.signals_in(np.asarray(self._log))

    def signals_in(self, room: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return the signals that are kept in a room, in the order of the stages."""
        names = sorted(self._kept, key=lambda name: name not in NEXT)
        places = dict(zip(names, places_of(names), strict=True))
        return {name: room[:, places[name]] for name in self._kept}

    def _asked(self) -> int:
        """Fly on; return whether a stage is asked, and say which one failed at which tick."""
        try:
            asked: int = calls.run(self.at, self._last, *self.flight)
        except Exception as error:
            raise self.failure(self.at, error) from error
        return asked

    def failure(self, at: Sequence[int], error: Exception) -> RuntimeError:
        """Return what is said of a stage that failed: its name and the tick."""
        name = self.chain.links[int(at[1])].stage.name
        return RuntimeError(f'stage `{name}` failed at tick {int(at[0])}: {error}')

    def step_in(self, signals: Any, tick: int, index: int) -> None:
        """Step a stage that has no kernel, among the signals of a tick."""
        stage, (reads, writes) = self.chain.links[index].stage, self._links[index]
        outputs = stage.step(tick, *(tuple(map(float, signals[place])) for place in reads))
        for place, values in zip(writes, outputs, strict=True):
            for i, value in zip(range(place.start, place.stop), values, strict=True):
                signals[i] = value


def _each(places: Iterable[slice]) -> list[int]:
    return [i for place in places for i in range(place.start, place.stop)]


class Flights:
    """Flights that wait for one another: chains of the same stages, one of which is not stepped.

    drivers : of each flight
    waits : name of that stage, which has no kernel
    kept : signals that each flight keeps
    places : signal -> its slice of `signals`
    signals : (n, numbers) those of the present tick
    read : (n, numbers) what the stage reads for which they wait, one signal after the other
    """

    def __init__(self, chains: Sequence[Chain], waits: str, kept: Collection[str]) -> None:
        self.drivers, self._waits = [Driver(chain, kept) for chain in chains], waits
        self.places = self.drivers[0].places
        for links in zip(*(chain.links for chain in chains), strict=True):
            stand_together([link.stage for link in links])

    def begin(self, starts: Sequence[Signals], ticks: int) -> None:
        """Begin the flights, as `Driver.begin` does."""
        self._rooms = self.drivers[0].room(ticks, len(starts))
        for driver, start, room in zip(self.drivers, starts, self._rooms, strict=True):
            driver.begin(start, ticks, room)
        flights = zip(*(driver.flight for driver in self.drivers), strict=True)
        tables, reads, signals, u, carried, _, before, after = flights
        rows = list(zip(*tables, strict=True))  # of a stage, those of all flights
        self._at, self.signals, self.read = np.zeros(3, np.int64), np.array(signals), np.array(u)
        self._flight = (
            self._at, ticks, np.array(rows) if COMPILED else rows, reads[0], self.signals,
            self.read, carried[0], self._rooms, before[0], after[0],
        )  # fmt: skip

    def go_on(self) -> None:
        """Fly on to the stage for which they wait, or to the end.

        Who steps that stage writes what it makes into `signals`, and calls `pass_stage`.
        """
        while self._asked():
            tick, index, flight = self._at.tolist()
            stage = self.drivers[flight].chain.links[index].stage
            if has_kernel(stage):
                stage.answer(tick, self.read[flight])
            elif stage.name == self._waits:
                return
            else:
                for driver, signals in zip(self.drivers, self.signals, strict=True):
                    driver.step_in(signals, tick, index)
                self.pass_stage()

    def pass_stage(self) -> None:
        """Let all flights go on with the stage that follows."""
        self._at[1] += 1

    def flown(self) -> list[dict[str, NDArray[np.float64]]]:
        """Return the signals (ticks + 1, width) that each flight has kept."""
        pairs = zip(self.drivers, self._rooms, strict=True)
        return [driver.signals_in(room) for driver, room in pairs]

    def _asked(self) -> int:
        """Fly on; return whether a stage is asked, and say which one failed at which tick."""
        try:
            asked: int = calls.run_together(*self._flight)
        except Exception as error:
            raise self.drivers[self._at[2]].failure(self._at, error) from error
        return asked
