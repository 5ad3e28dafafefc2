# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a report is made of before it is a page: paragraphs, tables, pictures, files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Text:
    """One paragraph."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table; the first cell of a row names it.

    columns : headings, with units
    rows : as many cells as columns; a row of one cell heads a group of rows
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure.

    name : stem of its PNG
    figure : of matplotlib, in the colours of `rpo_log.show.style` alone
    caption : what it shows; alt : what a reader who cannot see it should know
    """

    name: str
    figure: Any
    caption: str
    alt: str


@dataclass(frozen=True)
class File:
    """The text of a file, word for word."""

    name: str
    text: str


Block = Text | Table | Picture | File


@dataclass(frozen=True)
class Section:
    """A part of a report, with its heading."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole report.

    summary : one sentence
    missed : whether something that the report judges is missed
    """

    title: str
    summary: str
    sections: tuple[Section, ...] = field(default=())
    missed: bool = False

    @property
    def pictures(self) -> list[Picture]:
        """All pictures, in order."""
        return [b for s in self.sections for b in s.blocks if isinstance(b, Picture)]
