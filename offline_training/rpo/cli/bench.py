# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Speed beside a peer of the same run: each target is a ratio, on any machine."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from rpo.engine import lanes
from rpo.engine.cases import case_of_set
from rpo.engine.population import population_of
from rpo.engine.search import Simulator
from rpo.exports import formats
from rpo.montecarlo import config, outputs, run_batch
from rpo.montecarlo.execution import fly
from rpo.montecarlo.store import Store
from rpo.training.genes import GeneSpace
from rpo.training.gym import FinalApproach
from rpo.training.gym_vector import DispersedApproach
from rpo_core.chain.chain import Chain, start_of
from rpo_core.control.controller import load_fuzzy
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import load_scenario, load_set
from rpo_log.provenance import machine_facts

HEADINGS = '', 'what', 'target', 'ours', 'peer, same run', 'ratio', ''


class Row(NamedTuple):
    """A target: the least ratio to the peer; our result and the peer's; their ratio."""

    target: str
    what: str
    least: float
    ours: str
    peer: str
    ratio: float

    @property
    def cells(self) -> tuple[str, ...]:
        """The row under `HEADINGS`."""
        wanted, ratio = f'≥ {self.least:g} ×', f'{self.ratio:.3g} ×'
        verdict = 'held' if self.ratio >= self.least else 'MISSED'
        return self.target, self.what, wanted, self.ours, self.peer, ratio, verdict


def per_cpu_s(work: Callable[[], Any], count: int) -> float:
    """Return items per CPU second of this process, the best of five."""
    times = []
    for _ in range(5):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return count / min(times)


def inference(count: int = 20_000) -> tuple[float, float]:
    """Return inferences per CPU second: ours, and of pyfuzzylite; their outputs are equal."""
    import fuzzylite as fl

    controller = load_fuzzy('handmade')
    errors = np.random.default_rng(1).uniform(-1.0, 1.0, (2, count))
    law = population_of(controller).law(0, controller.system.samples)
    rows = lanes.make_scratch()
    outputs_of_ours = np.empty(count)
    engine = fl.FllImporter().from_string(formats.fll(controller))
    for name, values in zip(('position_error', 'velocity_error'), errors, strict=True):
        engine.input_variable(name).value = values

    def ours() -> None:
        lanes.infer_many(errors, law, rows, outputs_of_ours)

    rates = per_cpu_s(ours, count), per_cpu_s(engine.process, count)
    difference = np.abs(outputs_of_ours - engine.output_variable('force').value).max()
    if difference > 1e-9:
        raise InputError(f'pyfuzzylite must agree to 1e-9; it differs by {difference}')
    return rates


def training(evaluations: int, workers: int) -> tuple[float, float]:
    """Return wall and CPU time [s] of a budget: free tables, 216 starts, 2000 steps each."""
    space, rng = GeneSpace('free'), np.random.default_rng(1)
    with Simulator([case_of_set(load_set('paper_training'))], workers) as simulator:
        simulator.fly(space.decode(rng.random((2, space.size))))  # compiles
        began, cpu = time.perf_counter(), time.process_time()
        for first in range(0, evaluations, 60):
            count = min(60, evaluations - first)
            simulator.fly(space.decode(rng.random((count, space.size))))
        return time.perf_counter() - began, time.process_time() - cpu


def campaign(runs: int, workers: int) -> tuple[float, float, float]:
    """Return wall and CPU time [s] of the campaign `paper_test`, and of a run stage by stage."""
    chosen = config.load('paper_test', runs=runs)
    run_batch.fly_runs(chosen, 0, 1)  # compiles
    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder) / 'campaign', chosen)
        began, cpu = time.perf_counter(), time.process_time()
        fly(store, workers, progress=lambda count, successful: None)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    scenario = run_batch.scenario_of(chosen, 1)
    stages, signals = Chain.of(scenario, chosen.controller), start_of(scenario)

    def stepped() -> None:
        stages.reset()
        for tick in range(scenario.ticks):
            stages.step(tick, signals)

    return wall, cpu, 1.0 / per_cpu_s(stepped, 1)


def environments(env: Any, count: int, steps: int) -> float:
    """Return ticks per CPU second of an environment that a spring and a damper fly."""
    rates = []
    for _ in range(3):  # the first steps compile
        seen, _ = env.reset(seed=1)
        began = time.process_time()
        for _ in range(steps):
            seen, *_ = env.step(-2.0 * seen[..., :3] - 6.0 * seen[..., 3:6])
        rates.append(steps * count / (time.process_time() - began))
    return max(rates)


LOOP = 'rpo_ctrl fuzzy_controller', 'rpo_sim disturbance_injector'
STAGES = *LOOP, 'rpo_ctrl navigation', 'rpo_ctrl guidance', 'rpo_ctrl assurance'
TURNS = *STAGES, 'rpo_ctrl attitude_controller'
IN_ONE = 'rpo_bringup flight_software', LOOP[1]
LOOPS: tuple[tuple[str, str, float, str, Sequence[str], int], ...] = (
    ('P4', 'ROS loop, as 4 processes', 0.6, 'paper_test', LOOP, 7),
    ('P4', 'ROS loop, in one process', 1.2, 'paper_test', (), 7),
    ('P5', 'full chain, as 7 processes', 0.15, 'docking_leo', STAGES, 7),
    ('B7', 'six degrees of freedom, as 8 processes', 0.09, 'tumbling_docking', TURNS, 3),
    ('B7', 'six degrees of freedom, flight software in one', 0.15, 'tumbling_docking', IN_ONE, 3),
)
"""Target, subject, least ratio to the peer, scenario, nodes beside plant and recorder, flights."""


@contextmanager
def nodes() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Yield what starts a node of a package, in a ROS domain of this call; none is left."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    started: list[subprocess.Popen[str]] = []

    def start(name: str, *words: str) -> subprocess.Popen[str]:
        package, executable = name.split()
        places = os.pathsep.join(f'{prefix}/lib/{package}' for prefix in prefixes)
        found = shutil.which(executable, path=places)
        if found is None:
            raise InputError(f'no executable {name}: `source ros_ws/env.bash` first')
        output: Any = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, 'text': True}
        words = found, *words
        started.append(subprocess.Popen(words, env=environment, start_new_session=True, **output))
        return started[-1]

    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(random.randrange(1, 102))}
        environment |= {'ROS_LOG_DIR': folder, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        try:
            yield start
        finally:
            for node in started:
                if node.poll() is None:
                    os.killpg(node.pid, signal.SIGKILL)
                node.communicate()


def ended(node: subprocess.Popen[str]) -> str:
    """Return what a node prints until it ends; raises InputError if it fails."""
    said, _ = node.communicate(timeout=300.0)
    if node.returncode:
        raise InputError(f'a node ended with {node.returncode}: {said[-300:]!r}')
    return said


def ping_pong() -> float:
    """Return round trips per second of two bare rclpy processes."""
    with nodes() as start:
        said = ended(start('rpo_bringup ping_pong'))
        return float(re.findall(r'([\d.]+) round trips', said)[-1])


def ticks_per_s(said: str, scenario: str) -> float:
    """Return ticks per second from `flying` to `finished`, as the plant says them."""
    times = dict(map(reversed, re.findall(r'\[(\d+\.\d+)\] \[plant\]: (flying|finished)', said)))
    if len(times) != 2:
        raise InputError(f'no times of the flight in the output of the plant: {said[-300:]!r}')
    return load_scenario(scenario).ticks / (float(times['finished']) - float(times['flying']))


def loop(scenario: str, others: Sequence[str]) -> float:
    """Return ticks per second of a recorded flight: nodes in one process, or each in its own."""
    with nodes() as start, tempfile.TemporaryDirectory() as folder:
        run = f'{folder}/run'
        if not others:
            words = '--scenario', scenario, '--no-report', '--output', run
            return ticks_per_s(ended(start('rpo_bringup final_approach', *words)), scenario)
        for name in others:
            start(name)
        start('rpo_log recorder', '--ros-args', '-p', f'output:={run}')
        words = '--ros-args', '-p', f'scenario:={scenario}', '-p', 'wait_for_recorder:=true'
        return ticks_per_s(ended(start('rpo_sim plant', *words)), scenario)


def in_turns(flight: Callable[[], float], turns: int) -> tuple[float, float, float]:
    """Fly in turns with the peer; return the medians of both, and of the ratios.

    The same peer differs by a factor of two from one start to the next, and a machine that becomes
    faster or slower meets both alike: each flight is compared with the peers before and after it.
    """
    trips, rates = [ping_pong()], []
    for _ in range(turns):
        rates.append(flight())
        trips.append(ping_pong())
    ratios = [2.0 * rate / sum(two) for rate, two in zip(rates, pairwise(trips), strict=True)]
    return median(rates), median(trips), median(ratios)


def rows(what: str, evaluations: int, runs: int, workers: int) -> Iterator[Row]:
    """Measure a part, or all."""
    if what in ('all', 'inference', 'training'):
        ours, peer = inference()
        yield Row('P1', 'inference', 100.0, f'{ours:.2e}/s', f'{peer:.2e}/s', ours / peer)
    if what in ('all', 'training'):
        wall, cpu = training(evaluations, workers)
        naive_s = evaluations * 216 * 3 * 2000 / peer  # starts, axes, steps; without symmetry
        said = f'{wall:.1f} s ({cpu:.0f} s of CPU)', f'{naive_s / 3600:.1f} h of CPU'
        yield Row('P2', f'training, {evaluations} controllers', 800.0, *said, naive_s / cpu)
    if what in ('all', 'campaign'):
        wall, cpu, one = campaign(runs, workers)
        said = f'{wall:.1f} s ({cpu:.1f} s of CPU)', f'{one * runs:.0f} s of CPU'
        yield Row('P3', f'campaign, {runs} runs', 15.0, *said, one * runs / cpu)
    if what in ('all', 'learning'):
        ours = environments(DispersedApproach(4000), 4000, 100)
        peer = environments(FinalApproach('paper_test'), 1, 1000)
        said = f'{ours:.2e} ticks/s', f'{peer:.2e} ticks/s, one at a time'
        yield Row('P6', 'environments, 4000 side by side', 60.0, *said, ours / peer)
    if what in ('all', 'ros'):
        for target, name, least, scenario, others, turns in LOOPS:
            rate, trips, ratio = in_turns(lambda s=scenario, o=others: loop(s, o), turns)  # type: ignore[misc]
            yield Row(target, name, least, f'{rate:.0f} ticks/s', f'{trips:.0f} trips/s', ratio)


def saved(found: Sequence[Row], folder: Path, page: Path | None) -> Path:
    """Write the table as JSON, and into a page of the documentation; return the file."""
    date, facts = datetime.now(timezone.utc), machine_facts()
    facts['load_per_core'] = round(os.getloadavg()[0] / len(os.sched_getaffinity(0)), 2)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{date:%Y-%m-%d-%H%M%S}.json'
    document = {'machine': facts, 'rows': [row._asdict() for row in found]}
    outputs.write_text(path, json.dumps(document, indent=2) + '\n')
    if page is not None:
        head = f'Measured {date:%Y-%m-%d} on {facts["processor"]}, Python {facts["python"]}; '
        head += f'load per core {facts["load_per_core"]:g}.'
        table = outputs.markdown_table(HEADINGS, [row.cells for row in found])
        outputs.put(page, 'rpo bench', '\n'.join([head, '', *table]))
    return path
