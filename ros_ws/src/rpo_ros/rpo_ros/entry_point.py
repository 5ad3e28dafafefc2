# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The first lines that a command runs: `--help`, or a signal during its imports, ends it at once.

The imports of a node take most of a second, so this module imports almost nothing.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
from importlib import import_module
from itertools import takewhile
from types import FrameType

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

GENERATOR = 'rosidl_generator_py.generate_py_impl'
"""Writes Python code from message definitions, which no node does. Every message module imports it
if it can: with its parser it is a large part of the CPU time that a node takes to start."""

LONGEST_END_S = 20.0
"""Longest time for the middleware and the interpreter to end, once a node has closed its files."""


def end_in_time() -> None:
    """Let the process end within LONGEST_END_S, whatever its threads do.

    A recorder that had closed its log was once seen to use the processor for ever: a thread of the
    middleware did not stop. Such a process says where each thread is, and ends with exit code 1.
    """
    faulthandler.dump_traceback_later(LONGEST_END_S, exit=True)


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that end a node: Ctrl-C, `kill`, a closed terminal unless under nohup."""
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return signal.SIGINT, signal.SIGTERM
    return signal.SIGINT, signal.SIGTERM, signal.SIGHUP


def start(module: str, interrupted: int = 0) -> int:
    """Return the exit code of a module's `main`; `rpo_ros.running` then takes over the signals.

    Without mcap, which rosdep cannot install, one sentence says what does.

    interrupted : exit code where a signal comes before
    """

    def leave(_number: int, _frame: FrameType | None) -> None:
        os._exit(interrupted)  # nothing has started yet

    for number in stop_signals():
        signal.signal(number, leave)
    sys.modules.setdefault(GENERATOR, None)  # type: ignore[arg-type]
    try:
        code: int = import_module(module).main()
    except ModuleNotFoundError as error:
        from rpo_core.files.validation import missing_library

        sentence = missing_library(error.name)
        if sentence is None:
            raise
        print(sentence, file=sys.stderr)
        return EXIT_BAD_INPUT
    end_in_time()
    # The interpreter's end takes that watch along, and after it Fast DDS was once seen to spin for
    # ever in its exit handlers. This one is the kernel's.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_END_S)
    gc.freeze()  # else the interpreter collects the objects of numba at exit, which takes seconds
    return code


def asks_for_help() -> bool:
    """Return whether the command line holds `--help`."""
    return bool({'-h', '--help'} & set(sys.argv[1:]))


def start_node(module: str, interpreted: bool = False) -> int:
    """Run the node of a module, or answer `--help` without importing it; return the exit code.

    module : PACKAGE.NAME_node; the node's parameters are those of NAME in PACKAGE
    interpreted : whether kernels are interpreted unless `RPO_JIT` says otherwise: where a node
        calls few, importing numba takes most of the CPU time of its start
    """
    if interpreted and not os.environ.get('RPO_JIT'):
        os.environ['RPO_JIT'] = '0'
    from rpo_core.files.output import standard_output

    with standard_output():
        return _start_node(module)


def _start_node(module: str) -> int:
    package, _, name = module.removesuffix('_node').partition('.')
    command = f'ros2 run {package} {name}'
    from rpo_ros import parameter_rows

    rows = parameter_rows.tables(package)[name]
    if asks_for_help():
        print(parameter_rows.usage(command, _docstring(module), rows))
        return 0
    # Not remove_ros_args: rcl reads a bare `scenario:=quick` as an old form of remapping.
    stray = list(takewhile(lambda argument: argument != '--ros-args', sys.argv[1:]))
    if stray:
        print(
            f'unknown argument {stray[0]!r}: write parameters as --ros-args -p NAME:=VALUE; see '
            f'`{command} --help`',
            file=sys.stderr,
        )
        return EXIT_BAD_INPUT
    if sentence := parameter_rows.refusal(sys.argv, rows, command):
        print(sentence, file=sys.stderr)
        return EXIT_BAD_INPUT
    return start(module)


def _docstring(module: str) -> str:
    """Return the docstring of a module, without importing it."""
    import ast
    from importlib.util import find_spec
    from pathlib import Path

    spec = find_spec(module)
    source = Path(spec.origin).read_text(encoding='utf-8') if spec and spec.origin else ''
    return ast.get_docstring(ast.parse(source)) or ''
