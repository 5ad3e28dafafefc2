# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The driver: flies the stages of a chain tick by tick, kernel after kernel. It knows no stage.

All signals stand in one flat array, laid out from the links of the chain. A stage without a kernel
is called as Python, at its place in the tick.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.chain import NO_FORCE, Chain, Signals
from rpo_core.kernels import calls
from rpo_core.kernels.jit import COMPILED, as_table
from rpo_core.stage import has_kernel, places_of, stand_together, width_of
from rpo_core.wire.interfaces import NEXT, current


class Layout:
    """Where the numbers of a tick stand, for all chains of the same stages.

    places : signal -> its slice of the flat array, of the last stage that writes it
    links : of each stage, the slices of what it reads and writes
    size, u : how many numbers there are, and how many a stage reads at most
    kept : signals of each tick that a flight keeps, and their slices of its room
    unread : signals that no stage reads, and that are not kept
    rows, tables : what `calls.run` takes: the end of its rows; reads, carried, before, after
    """

    def __init__(
        self,
        links: Sequence[tuple[Sequence[str], Sequence[str], bool]],
        inputs: Sequence[str],
        kept: Collection[str] | None,
    ) -> None:
        """Lay out the signals that links read and write, each with or without a kernel."""
        self.size = 0
        written = [{name: self._place(name) for name in writes} for _, writes, _ in links]
        self.places = {name: place for block in written for name, place in block.items()}
        for name in inputs:
            if current(name) == name and name not in self.places:
                self.places[name] = self._place(name)
        made = list(self.places)
        reads = [name for names, _, _ in links for name in names]
        earlier = list(dict.fromkeys(name for name in reads if current(name) != name))
        self.places |= {name: self._place(name) for name in (*earlier, NO_FORCE)}
        outputs = dict.fromkeys(name for block in written for name in block)
        keeps = [name for name in outputs if kept is None or name in kept]
        self.unread = frozenset(outputs).difference(map(current, reads), keeps)
        ordered = sorted(keeps, key=lambda name: name not in NEXT)
        rooms = dict(zip(ordered, places_of(ordered), strict=True))
        self.kept = {name: rooms[name] for name in keeps}
        before = self._of(name for name in keeps if name in NEXT)
        after = self._of(name for name in keeps if name not in NEXT)
        carried = [name for name in earlier if current(name) in made]
        pairs = list(zip(self._of(map(current, carried)), self._of(carried), strict=True))
        standing = dict(self.places)  # where a stage reads a signal that several write
        self.links, self.rows, flat = [], [], list[int]()
        for (names, _, by_kernel), block in zip(links, written, strict=True):
            read, writes = [standing[name] for name in names], [*block.values()]
            size, places = writes[-1].stop - writes[0].start, _each(read)
            self.rows.append((len(flat), len(places), writes[0].start, size if by_kernel else 0))
            self.links.append((read, writes))
            flat += places
            standing |= block
        self.u, self.width = 1 + max(row[1] for row in self.rows), len(before) + len(after)
        tables: tuple[Any, ...] = flat, np.array(pairs).reshape(-1, 2), before, after
        self.tables = [as_table(table, np.int64) for table in tables]

    def _place(self, name: str) -> slice:
        """Return room for a signal after those that have some."""
        first, self.size = self.size, self.size + (width_of(current(name)) if name else 3)
        return slice(first, self.size)

    def _of(self, names: Iterable[str]) -> list[int]:
        """Return the places of signals."""
        return _each(self.places[name] for name in names)


_layout = lru_cache(maxsize=64)(Layout)


class Driver:
    """A chain that is flown.

    kept : signals of each tick that a flight keeps; None: all that its stages make
    places : signal -> its slice of the flat array, of the last stage that writes it
    spent : what its thrusters spent up to the last state (`Stage.spent`)
    """

    spent: tuple[float, float, int] | None = None

    def __init__(self, chain: Chain, kept: Collection[str] | None = None) -> None:
        self.chain = chain
        stages = [(link.reads, link.stage) for link in chain.links]
        links = tuple((reads, tuple(s.outputs), has_kernel(s)) for reads, s in stages)
        self._layout = _layout(links, chain.inputs, None if kept is None else tuple(kept))
        self.places = self._layout.places
        for link in chain.links:
            link.stage.take_unread(self._layout.unread)

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
        return np.empty((ticks + 1, *flights, self._layout.width))

    def begin(self, start: Signals, ticks: int, room: NDArray[np.float64] | None = None) -> None:
        """Begin a flight of ticks 0 to `ticks`: each stage forgets, signals are those of tick 0.

        room : for what is kept; None: it is made

        at : (2,) tick, and stage of it, where the flight stands
        flight : what `calls.run` takes, from its rows on
        signals : flat, those of this tick; `places` says where
        """
        self.chain.reset()
        layout, flat = self._layout, np.zeros(self._layout.size)
        for name, values in start.items():
            flat[self.places[name]] = values
        log = as_table(self.room(ticks)) if room is None else room
        reads, carried, before, after = layout.tables
        stages = [link.stage for link in self.chain.links]  # interpreted, memory is made anew
        kernels = [stage for stage in stages if has_kernel(stage)]
        calls.compile_together((type(s).kernel, s.p, s.m) for s in kernels)
        rows: Any = [
            (*(stage.row if has_kernel(stage) else (0, 0, 0)), *row)
            for stage, row in zip(stages, layout.rows, strict=True)
        ]
        rows = np.array(rows, np.int64) if COMPILED else rows
        self._u, self.at = as_table([0.0] * layout.u), as_table((0, 0), np.int64)
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
        return {name: room[:, place] for name, place in self._layout.kept.items()}

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
        stage, (reads, writes) = self.chain.links[index].stage, self._layout.links[index]
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
    parts : into which the flights are divided
    places : signal -> its slice of `signals`
    room : (ticks, n, numbers) for what is kept
    signals : (n, numbers) those of the present tick
    read : (n, numbers) what the stage reads for which they wait, one signal after the other
    """

    def __init__(
        self, chains: Sequence[Chain], waits: str, kept: Collection[str], parts: int = 1
    ) -> None:
        self.drivers, self._waits = [Driver(chain, kept) for chain in chains], waits
        self.places = self.drivers[0].places
        self._parts = list(pairwise(len(chains) * i // parts for i in range(parts + 1)))
        for links in zip(*(chain.links for chain in chains), strict=True):
            stand_together([link.stage for link in links])

    def begin(
        self, starts: Sequence[Signals], ticks: int, room: NDArray[np.float64] | None = None
    ) -> None:
        """Begin the flights, as `Driver.begin` does."""
        self.room = self.drivers[0].room(ticks, len(starts)) if room is None else room
        for s, (driver, start) in enumerate(zip(self.drivers, starts, strict=True)):
            driver.begin(start, ticks, self.room[:, s])
        flights = zip(*(driver.flight for driver in self.drivers), strict=True)
        tables, reads, signals, u, carried, _, before, after = flights
        rows = list(zip(*tables, strict=True))  # of a stage, those of all flights
        self._at = np.array([(0, 0, first) for first, _ in self._parts])
        self.signals, self.read = np.array(signals), np.array(u)
        self._last, self._flight = ticks, (
            np.array(rows) if COMPILED else rows, reads[0], self.signals, self.read, carried[0],
            self.room, before[0], after[0],
        )  # fmt: skip

    def go_on(self, each: Callable[..., Iterable[Any]] = map) -> None:
        """Fly on to the stage for which they wait, or to the end.

        Who steps that stage writes what it makes into `signals`, and calls `pass_stage`.

        each : may map on threads: of the parts of the flights, none reads what another writes
        """
        for _ in each(self._go_on, self._at, *zip(*self._parts, strict=True)):
            pass

    def _go_on(self, at: Any, first: int, end: int) -> None:
        """Fly on some flights, from the first to that before the end."""
        while self._asked(at, first, end):
            tick, index, flight = at.tolist()
            stage = self.drivers[flight].chain.links[index].stage
            if has_kernel(stage):
                stage.answer(tick, self.read[flight])
            elif stage.name == self._waits:
                return
            else:
                for s in range(first, end):
                    self.drivers[s].step_in(self.signals[s], tick, index)
                at[1] += 1

    def pass_stage(self) -> None:
        """Let all flights go on with the stage that follows."""
        self._at[:, 1] += 1

    def flown(self) -> list[dict[str, NDArray[np.float64]]]:
        """Return the signals (ticks + 1, width) that each flight has kept."""
        return [driver.signals_in(self.room[:, s]) for s, driver in enumerate(self.drivers)]

    def _asked(self, at: Any, first: int, end: int) -> int:
        """Fly on; return whether a stage is asked, and say which one failed at which tick."""
        try:
            asked: int = calls.run_together(at, self._last, first, end, *self._flight)
        except Exception as error:
            raise self.drivers[at[2]].failure(at, error) from error
        return asked
