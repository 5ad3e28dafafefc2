# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `web`: the run live on a page in a browser on this machine; no account, no internet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rpo_bringup.views.listening import ListeningNode
from rpo_bringup.views.web_server import Feed, LivePage


class WebNode(ListeningNode):
    """Passes the run to the server of the page."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('web', overrides)
        self.page = LivePage(self.values['port'], Feed(self.live, self.topic))
        self.every(1.0 / self.values['rate_hz'], self._show)
        self.get_logger().info(f'{self.topic} is shown at {self.page.url}')

    def _show(self) -> None:
        self.page.feed.update(self.look)

    def close(self) -> None:
        """Disconnect the browsers."""
        self.page.close()


main = WebNode.main
