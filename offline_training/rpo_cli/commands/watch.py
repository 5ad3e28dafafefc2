# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo watch`: a run of ROS 2 nodes live on this terminal, or the log of a run."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_cli.commands.shared import interruptible
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo_mcap.read.run_log import RunLog
    from rpo_view.live import LiveRun


FRAMES_HZ = 10.0
"""Views of a log a second on a terminal; elsewhere, a line a second."""


def watch(
    run: Annotated[
        str, typer.Argument(help='folder or .mcap file, without ROS  [the nodes that run]')
    ] = '',
    rate: Annotated[
        float, typer.Option(min=0.0, help='of a log: simulated seconds a second, 0: at once')
    ] = 20.0,
    namespace: Annotated[str, typer.Option(help='of the nodes to watch')] = '/',
    until_end: Annotated[bool, typer.Option(help='leave when the run has ended')] = False,
) -> None:
    """Watch a run: range, rates, force bars, the rules that act; Ctrl-C leaves.

    A run of ROS 2 nodes live, or the log of any run.
    """
    if run:
        with interruptible(lambda: f'{run}: left'):
            _play(run, rate)
        return
    ros2 = shutil.which('ros2')
    if ros2 is None:
        raise InputError('`ros2` is not on the PATH: `source ros_ws/env.bash` in this shell first')
    command = [
        ros2,
        'run',
        'rpo_view',
        'watch',
        '--ros-args',
        '-r',
        f'__ns:=/{namespace.strip("/")}',
    ]
    os.execv(ros2, [*command, '-p', f'until_end:={str(until_end).lower()}'])


def _play(path: str, rate: float) -> None:
    """Show the log of a run, so many simulated seconds a second."""
    from rich.console import Console
    from rich.live import Live

    from rpo_mcap.read.run_log import read_run
    from rpo_view import terminal

    console, log = Console(), read_run(path)
    period_s = 1.0 / FRAMES_HZ if console.is_terminal else 1.0
    every = max(1, round((rate * period_s or 10.0) / log.dt_s))
    with Live(console=console, auto_refresh=False) as screen:
        for live in _seen(log, every):
            if console.is_terminal:
                screen.update(terminal.view(live, path), refresh=True)
            else:
                typer.echo(terminal.line(live, path))
            time.sleep(period_s if rate else 0.0)


def _seen(log: RunLog, every: int) -> Iterator[LiveRun]:
    """Yield what a viewer of a flight knows at every n-th tick of its log, and at the last one."""
    from rpo_core.control.controller_file import received
    from rpo_core.wire import interfaces
    from rpo_core.wire.statuses import Manifest, RunStatus
    from rpo_ctrl import explain
    from rpo_mcap.read.run_log import controller_of, scenario_of
    from rpo_view.live import LiveRun

    live, scenario, controller = LiveRun(), scenario_of(log), controller_of(log)
    texts = {f'file.{name}': data.decode() for name, data in log.attachments.items()}
    for role in ('plant', 'controller'):
        values = {'role': role, 'parameter.controller': controller.name, **texts}
        live.on_manifest(Manifest(role, role, '', values))
    forces = {
        'force_n': interfaces.CONTROL_FORCE,
        'disturbance_n': interfaces.DISTURBANCE_FORCE,
        'exerted_n': interfaces.EXERTED_FORCE,
    }
    said = {tick: RunStatus.of(status) for tick, status in log.statuses}
    for row, tick in enumerate(log.ticks.tolist()):
        stamp_ns = log.base.stamp_ns(tick)
        signals = {name: tuple(values[row].tolist()) for name, values in log.values.items()}
        if tick in said:
            live.on_status(said[tick])
        turn = signals.get(interfaces.CHASER_ATTITUDE)
        live.on_state(stamp_ns, signals[interfaces.RELATIVE_STATE], turn)
        for name, signal in forces.items():
            setattr(live, name, signals.get(signal))
        if row % every and row < len(log.ticks) - 1:
            continue
        if interfaces.REFERENCE_STATE in signals:
            live.onboard.on_reference(stamp_ns, signals[interfaces.REFERENCE_STATE])
        for name in (interfaces.REFERENCE_ATTITUDE, interfaces.NAVIGATION_ATTITUDE):
            if name in signals:
                live.onboard.on_turn(name, stamp_ns, signals[name])
        if interfaces.NAVIGATION_STATE in signals:
            live.onboard.on_estimate(stamp_ns, signals[interfaces.NAVIGATION_STATE][:6], ())
        read, force_n = received(scenario, signals)[0], signals[interfaces.CONTROL_FORCE]
        reasons = explain.reasons(controller, read, force_n, tick)
        for axis, (sentence, pairs) in zip('xyz', reasons, strict=True):
            live.on_decision(axis, sentence, {name: repr(value) for name, value in pairs})
        yield live
