# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `watch`: a run on the terminal: range, rates, force bars, active rules."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rpo_core.files.validation import InputError
from rpo_view.listening import ListeningNode

try:
    from rich.console import Console
    from rich.live import Live

    from rpo_view import terminal
except ImportError:  # an optional layer
    Console = None

EXIT_ABORTED = 1


class WatchNode(ListeningNode):
    """Draws the run; Ctrl-C ends it."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('watch', overrides)
        if Console is None:
            raise InputError('rich is not installed: `make setup LAYERS=view`, or pip, installs it')
        console = Console()
        self._live: Live | None = None
        period_s = self.values['line_every_s']
        if console.is_terminal:
            self._live = Live(console=console, auto_refresh=False, screen=False)
            self._live.start()
            period_s = 1.0 / self.values['rate_hz']
        self.every(period_s, self._show)

    def _show(self) -> None:
        self.look()
        if self._live is not None:
            self._live.update(terminal.view(self.live, self.topic), refresh=True)
        else:
            print(terminal.line(self.live, self.topic), flush=True)
        if self.values['until_end'] and self.live.phase in ('finished', 'aborted'):
            self.exit_code = EXIT_ABORTED if self.live.phase == 'aborted' else 0
            self.done = True

    def close(self) -> None:
        """Keep the last view on the terminal."""
        if self._live is not None:
            self._live.stop()


main = WatchNode.main
