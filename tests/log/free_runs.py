# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights against the wall clock, and their logs: nodes miss ticks, commands come late or never."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from log_runs import CLOCK, STATUS, Change

from rpo_core.chain.chain import Chain
from rpo_core.control.controller import dumps, load_controller
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.wire import cdr, interfaces
from rpo_log.format.run import RunSummary, TimeBase
from rpo_log.write.writer import RunLogWriter
from rpo_sim.plant import FreeRunningPlant

STALE_AFTER = 4


class FreeRun:
    """A flight in free running, and what its nodes say.

    lost : ticks whose command does not reach the plant
    missed : ticks at which a stage of the software does nothing, by its name
    unlogged : topics and ticks of the messages that the recorder does not get
    """

    def __init__(
        self,
        flown: Scenario,
        control: str = 'handmade',
        lost: Collection[int] = (),
        missed: Mapping[str, Collection[int]] | None = None,
        unlogged: Collection[tuple[str, int]] = (),
    ) -> None:
        self.law, self.scenario = load_controller(control), flown
        software = Chain.of(flown, self.law).part(*(p for p in Place if p < Place.UNLOADING))
        command = interfaces.CONTROL_FORCE if flown.attitude is None else interfaces.BODY_FORCE
        calm = flown.disturbance.is_zero
        peers = [command] if calm else [command, interfaces.DISTURBANCE_FORCE]
        self.plant = plant = FreeRunningPlant(flown, peers, STALE_AFTER)
        self.messages: list[tuple[str, int, bytes]] = []
        self.applied: list[tuple[float, ...]] = []
        delayed = [name for name in software.inputs if interfaces.current(name) != name]
        before: tuple[float, ...] = (0.0, 0.0, 0.0)
        software.reset()
        for tick in range(flown.ticks + 1):
            signals = {n: plant.signals[n] for n in interfaces.NEXT if n in plant.signals}
            signals |= dict.fromkeys(delayed, before)
            for link in software.links:
                if tick not in (missed or {}).get(link.stage.name, ()):
                    made = link.stage.step(tick, *(signals[name] for name in link.reads))
                    signals |= dict(zip(link.stage.outputs, made, strict=True))
            answers = {n: interfaces.row_of(n).whole(signals) for n in peers if n in signals}
            if tick in lost:
                answers.pop(command, None)
            for name, values in answers.items():
                plant.answer(name, plant.stamp_ns, values)
            for name in peers:
                applied = interfaces.row_of(interfaces.applied(name))
                signals[applied.name] = plant.applied(name)[:3]
                if applied.rider:
                    signals[applied.rider] = plant.applied(name)[3:]
            self.applied.append(plant.applied(command)[:3])
            turns = flown.named('attitude_control') is not None
            before = signals[interfaces.current(delayed[0])] if turns else self.applied[-1]
            self._say(tick, signals, unlogged)

    def _say(self, tick: int, signals: dict, unlogged: Collection[tuple[str, int]]) -> None:
        """Take what is said at a tick, and fly on to the next."""
        plant, stamp_ns, last = self.plant, self.plant.stamp_ns, tick == self.scenario.ticks
        figures = {key: repr(value) for key, value in plant.figures().items()}
        if not last:
            plant.advance()
        made = plant.last_signals(plant.answers) if last else plant.signals
        signals = {name: made[name] for name in plant.chain.outputs} | signals
        self.messages.append((CLOCK, tick, cdr.encode_clock(stamp_ns)))
        for row in interfaces.rows(logged=True):
            if row.name in signals and (row.name, tick) not in unlogged:
                data = row.layout_in(self.scenario).encode(stamp_ns, row.whole(signals))
                self.messages.append((f'/{row.name}', tick, data))
        if tick == 0 or last:
            values = {**figures, 'phase': 'finished' if last else 'running'}
            self.messages.append((STATUS, tick, cdr.encode_status(0, 'run', '', 'none', values)))

    def write(self, folder: Path, change: Change = lambda name, tick, data: data) -> RunSummary:
        """Write the log; `change` forges it."""
        flown, names = self.scenario, {name for name, *_ in self.messages}
        parameters = f'plant: {{mode: free_running, stale_after_ticks: {STALE_AFTER}}}\n'
        attached = {
            'scenario.yaml': scenario.dumps(flown).encode(),
            'controller.yaml': dumps(self.law).encode(),
            'parameters.yaml': parameters.encode(),
        }
        base = TimeBase(flown.epoch_ns, flown.dt_ns, flown.ticks)
        writer = RunLogWriter(folder, base, names, attached)
        for name, tick, data in self.messages:
            writer.write(name, tick, change(name, tick, data))
        return writer.close()
