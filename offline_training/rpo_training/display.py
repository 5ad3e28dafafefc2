# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Long work as it is watched: live on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from rich.console import Console
from rich.live import Live
from rich.progress import Progress

EVERY_S = 10.0
"""Time between lines where there is no terminal."""

Self = TypeVar('Self', bound='Display')


class Display:
    """Shows progress while it is entered.

    console : stderr if none is given
    live : what is drawn on a terminal; set by the subclass
    """

    live: Live | Progress

    def __init__(self, folder: Path, console: Console | None = None) -> None:
        self.console = console or Console(stderr=True)
        self.console.print(f'{folder}', highlight=False)
        self._last = -EVERY_S

    def __enter__(self: Self) -> Self:
        if self.console.is_terminal:
            self.live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.live.stop()

    def say(self, line: str) -> None:
        """Print a line where there is no terminal, if the last one was some time ago."""
        now = time.monotonic()
        if not self.console.is_terminal and now - self._last >= EVERY_S:
            self._last = now
            self.console.print(line, highlight=False, soft_wrap=True)
