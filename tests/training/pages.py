# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pages of reports, taken apart: elements by the standard library's parser, data of a replay."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from typing import Any

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.scenario.scenario import load_scenario

VOID = {'meta', 'link', 'br', 'hr', 'img', 'input'}


@dataclass
class Element:
    """An element, with all the text inside it."""

    tag: str
    attributes: dict[str, str]
    path: tuple[str, ...]
    text: str = ''


@dataclass
class Page(HTMLParser):
    """All elements in order; raises AssertionError where tags do not nest."""

    source: str
    elements: list[Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self._open: list[Element] = []
        self.feed(self.source)
        self.close()
        assert not self._open, [element.tag for element in self._open]

    def handle_starttag(self, tag, attrs):
        path = tuple(element.tag for element in self._open)
        element = Element(tag, {name: value or '' for name, value in attrs}, path)
        self.elements.append(element)
        if tag not in VOID:
            self._open.append(element)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag):
        assert self._open and self._open[-1].tag == tag, (tag, self._open[-1:])
        self._open.pop()

    def handle_data(self, data):
        for element in self._open:
            element.text += data

    def all(self, tag: str) -> list[Element]:
        """Return the elements of a tag."""
        return [element for element in self.elements if element.tag == tag]


def replayed(page: str) -> dict[str, Any]:
    """Return the data of a page with a replay."""
    (text,) = re.findall('<script type="application/json" id="data">(.*?)</script>', page)
    return json.loads(text)


def unpacked(text: str, width: int) -> Any:
    """Return the numbers (n, width) of an array in the data of a replay."""
    return np.frombuffer(base64.b64decode(text), '<f4').reshape(-1, width)


def straight(name: str, start: list[float], end: list[float], ticks: int) -> Flight:
    """Return a flight of a shipped scenario along a line, whatever its dynamics."""
    base = load_scenario(name)
    scenario = replace(base, duration_s=ticks * base.dt_s, initial_position_m=tuple(start))
    way = np.array(end) - np.array(start)
    positions = np.array(start) + np.linspace(0.0, 1.0, ticks + 1)[:, None] * way
    velocities = np.tile(way / scenario.duration_s, (ticks + 1, 1))
    zeros = np.zeros((ticks + 1, 3))
    return Flight(scenario, np.hstack([positions, velocities]), zeros, zeros)
