# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The commands in the documentation, and how they are run.

A shell block is a fenced block of `sh`, or an indented one that begins with one of `COMMANDS`. All
blocks of a page are run in their order, in one folder, line by line, and each line must end with
exit code 0, unless a comment before the block says otherwise:

    <!-- run: quick -->           also by `make test`
    <!-- run: shells -->          each line in a shell of its own, started in order; when one has
                                  ended, the others get Ctrl-C
    <!-- run: exit 1 -->          the exit code of the command (of shells: of the one that ends)
    <!-- run: with A for B -->    B replaced by A
    <!-- run: no, REASON -->      not run, only read

Several may be joined by `;`. `<!-- run first: COMMAND -->` at a page's head makes what it needs.
A block of Python or YAML that begins with the name of a file (`# mine.yaml`) is that file.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
GENERATED = DOCS / 'nodes'
PAGES = [page for page in sorted(DOCS.rglob('*.md')) if page.parent != GENERATED]
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *PAGES]

COMMANDS = {'cd', 'colcon', 'dask', 'git', 'make', 'mkdocs', 'pytest', 'python', 'python3', 'ros2'}
COMMANDS |= {'rpo', 'source', '.venv/bin/pre-commit'}
LINKED = ('Makefile', 'docs', 'offline_training', 'pyproject.toml', 'ros_ws', 'tests')
"""What the folder in which a page is run has of the checkout."""

_FENCED = r'^```(?P<language>\w*)\n(?P<fenced>.*?)^```'
_INDENTED = r'(?<=\n\n)(?P<indented>(?:    [^\n]*\n|\n(?=    ))+)'
_BLOCK = re.compile(
    rf'(?:^<!-- run: (?P<orders>[^>]*?) -->\n+)?(?:{_FENCED}|{_INDENTED})', re.MULTILINE | re.DOTALL
)
_FIRST = re.compile(r'^<!-- run first: (.*?) -->$', re.MULTILINE)
_ORDER = re.compile(r'quick|shells|exit \d+|with .+ for .+|no, \w.+')


@dataclass(frozen=True)
class Block:
    """One shell block; lines are commands, continuations joined."""

    page: Path
    line: int
    lines: tuple[str, ...]
    orders: tuple[str, ...]

    @property
    def place(self) -> str:
        """Page and line, as an error names them."""
        return f'{self.page.relative_to(ROOT)}:{self.line}'

    @property
    def is_run(self) -> bool:
        """Whether it is run at all."""
        return not any(order.startswith('no, ') for order in self.orders)

    @property
    def exit_code(self) -> int:
        """What its commands must end with."""
        codes = [int(order.split()[1]) for order in self.orders if order.startswith('exit ')]
        return codes[0] if codes else 0

    @property
    def commands(self) -> list[str]:
        """The lines as they are run."""
        lines = list(self.lines)
        for order in self.orders:
            if order.startswith('with '):
                new, old = order.removeprefix('with ').split(' for ')
                assert any(old in line for line in lines), f'{self.place}: there is no {old!r}'
                lines = [line.replace(old, new) for line in lines]
        return lines


def text_of(page: Path) -> str:
    """Return a page with an empty line before it, so that every block has one."""
    return '\n\n' + page.read_text()


def blocks(page: Path) -> Iterator[Block]:
    """Yield the shell blocks of a page."""
    text = text_of(page)
    for match in _BLOCK.finditer(text):
        body = match['indented'] or match['fenced'] or ''
        lines = [line.strip() for line in body.replace('\\\n', ' ').splitlines() if line.strip()]
        lines = [re.sub(r'\s+', ' ', line) for line in lines if not line.startswith('#')]
        is_shell = match['language'] == 'sh' or (
            match['indented'] and lines and lines[0].split()[0] in COMMANDS
        )
        orders = tuple(filter(None, (match['orders'] or '').split('; ')))
        unknown = [order for order in orders if not _ORDER.fullmatch(order)]
        line = text.count('\n', 0, match.start()) - 1
        assert not unknown, f'{page.name}:{line}: {unknown[0]!r} is no way to run a block'
        if is_shell and lines:
            yield Block(page, line, tuple(lines), orders)


def code(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    found = re.findall(_FENCED, text_of(page), re.MULTILINE | re.DOTALL)
    return [body for name, body in found if name == language]


def files_of(page: Path) -> dict[str, str]:
    """Return name -> text of the blocks that are files."""
    bodies = [*code(page, 'python'), *code(page, 'yaml')]
    return {name[1]: body for body in bodies if (name := re.match(r'# (\w+\.\w+)\n', body))}


def needed_first(page: Path) -> list[str]:
    """Return the commands that make what a page takes for given."""
    return _FIRST.findall(page.read_text())


def folder_like_the_checkout(path: Path) -> Path:
    """Make a folder in which a page's relative paths lead to the checkout, but runs/ is its own."""
    path.mkdir()
    for name in LINKED:
        (path / name).symlink_to(ROOT / name)
    return path


def run_line(command: str, cwd: Path, env: Mapping[str, str], deadline_s: float) -> tuple[int, str]:
    """Return exit code and output of one line."""
    output = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, 'errors': 'replace'}
    shell = ['bash', '-c', command]
    done = subprocess.run(
        shell, cwd=cwd, env=env, stdin=subprocess.DEVNULL, timeout=deadline_s, **output
    )
    return done.returncode, done.stdout


def run_shells(block: Block, cwd: Path, env: Mapping[str, str], deadline_s: float) -> None:
    """Run the lines of a block side by side, each in a process group, as in a terminal."""
    log = (cwd / 'shells.txt').open('w+')
    options = {'cwd': cwd, 'env': env, 'stdout': log, 'stderr': log, 'start_new_session': True}
    shells = [['bash', '-c', f'exec {line}'] for line in block.commands]
    running = [subprocess.Popen(shell, **options) for shell in shells]
    try:
        end = time.monotonic() + deadline_s
        while all(process.poll() is None for process in running):
            assert time.monotonic() < end, f'{block.place}: nothing ended\n{_said(log)}'
            time.sleep(0.05)
        first = next(process for process in running if process.poll() is not None)
        time.sleep(2.0)  # who leaves by itself has time to do so
        for process in running:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)  # Ctrl-C
        codes = [process.wait(30.0) for process in running]
        assert first.returncode == block.exit_code, f'{block.place}: {codes}\n{_said(log)}'
        clean = {0, block.exit_code, -signal.SIGINT, 128 + signal.SIGINT}
        assert set(codes) <= clean, f'{block.place}: {codes}\n{_said(log)}'
    finally:
        for process in running:
            with suppress(ProcessLookupError):  # the nodes behind a stock `ros2 run` too
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        log.close()


def _said(log: object) -> str:
    return Path(log.name).read_text(errors='replace')[-4000:]  # type: ignore[attr-defined]


def run_block(block: Block, cwd: Path, env: Mapping[str, str], deadline_s: float) -> None:
    """Run a block as its page says, beside the files of the page."""
    for name, text in files_of(block.page).items():
        (cwd / name).write_text(text)
    if 'shells' in block.orders:
        run_shells(block, cwd, env, deadline_s)
        return
    for command in block.commands:
        returned, said = run_line(command, cwd, env, deadline_s)
        assert returned == block.exit_code, (
            f'{block.place}: `{command}`: {returned}\n{said[-4000:]}'
        )
