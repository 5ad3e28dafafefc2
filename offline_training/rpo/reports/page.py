# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A report as PNGs and one HTML page.

The page has no script and loads nothing, which its content security policy enforces. Pictures are
inline SVG whose colours are CSS variables: they follow the reader's light or dark theme, and print.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from functools import partial
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

from rpo.montecarlo.outputs import writing
from rpo.reports.replay import Replayed, page_of
from rpo_core.files import parse_yaml
from rpo_core.files.output import write_aside, write_text
from rpo_core.files.validation import InputError
from rpo_log.bag import bag_at
from rpo_log.format.run import log_files
from rpo_log.show import style
from rpo_log.show.replay import filled


class Text(NamedTuple):
    """One paragraph."""

    text: str


class Table(NamedTuple):
    """A table; the first cell of a row names it.

    columns : headings, with units
    rows : as many cells as columns; a row of one cell heads a group of rows
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Picture(NamedTuple):
    """A figure.

    name : stem of its PNG
    figure : of matplotlib, in the colours of `rpo_log.show.style` alone
    caption : what it shows; alt : what a reader who cannot see it should know
    """

    name: str
    figure: Any
    caption: str
    alt: str


CAPTIONS: dict[str, dict[str, str]] = parse_yaml(
    files('rpo.reports').joinpath('captions.yaml').read_text('utf-8')
)


def picture(key: str, figure: Any, **facts: Any) -> Picture:
    """Return a picture with the texts of `captions.yaml`, which facts complete."""
    caption, alt = (CAPTIONS[key][part].format(**facts) for part in ('caption', 'alt'))
    return Picture(key.partition(',')[0], figure, caption, alt)


class File(NamedTuple):
    """The text of a file, word for word."""

    name: str
    text: str


class Fold(NamedTuple):
    """Blocks that a reader opens."""

    title: str
    blocks: tuple[Text | Table, ...]


Block = Text | Table | Picture | File | Fold


class Section(NamedTuple):
    """A part of a report, with its heading."""

    title: str
    blocks: tuple[Block, ...]


class Report(NamedTuple):
    """A whole report.

    summary : one sentence
    missed : whether something that the report judges is missed
    verdict : of a flight, in words
    flights : that `replay.html` beside the page shows; note : what they have in common
    """

    title: str
    summary: str
    sections: tuple[Section, ...] = ()
    missed: bool = False
    verdict: str = ''
    flights: tuple[Replayed, ...] = ()
    note: str = ''

    @property
    def pictures(self) -> list[Picture]:
        """All pictures, in order."""
        return [b for s in self.sections for b in s.blocks if isinstance(b, Picture)]


def plain(text: str) -> str:
    """Return a text with units as a page writes them."""
    return text.replace('N^2 s', 'N²s')


PAGE, REPLAY = 'report.html', 'replay.html'

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_VERDICTS = dict.fromkeys(('holds', 'held', 'proven'), 'good') | dict.fromkeys(
    ('MISSED', 'refuted', 'undecided'), 'bad'
)
_LONGEST = 40
"""Characters of a number with its unit; a sentence may begin with one, and is folded."""
_NUMBER = re.compile(r'[≤≥<>]?\s*[-+−]?[\d.,]')


def write(report: Report, folder: Path) -> list[Path]:
    """Write the pictures as PNGs, a replay, and the page; return their paths, the page last."""
    paths = [folder / f'{picture.name}.png' for picture in report.pictures]
    with writing(folder), style.applied():
        folder.mkdir(parents=True, exist_ok=True)
        for picture, path in zip(report.pictures, list(paths), strict=True):
            write_aside(path, partial(_save, picture, format='png'))
        if report.flights:
            replay = page_of(report.title, report.flights, report.note)
            paths.append(folder / REPLAY)
            write_text(paths[-1], replay)
        write_text(folder / PAGE, html(report))
    return [*paths, folder / PAGE]


def _save(picture: Picture, target: Any, **options: Any) -> None:
    """Draw a picture; its layout is found the first time, and stays."""
    picture.figure.savefig(target, **options)
    picture.figure.set_layout_engine('none')


def html(report: Report) -> str:
    """Return the page."""
    sections, flights = report.sections, report.flights
    links = (f'<li><a href="#{_anchor(s)}">{escape(s.title)}</a></li>' for s in sections)
    judged = any(one.missed is not None for one in flights)
    word = 'bad' if report.missed else 'good' if judged else ''
    verdict = f'<p class="verdict {word}">{escape(report.verdict)}</p>'
    what = 'this flight' if len(flights) == 1 else f'{len(flights)} flights'
    replay = f'<p><a class="replay" href="{REPLAY}">Replay {what} in three dimensions</a></p>'
    return filled(
        'rpo.reports',
        'page.html',
        policy=_POLICY,
        title=escape(report.title),
        style=f'{style.variables()}\n{files("rpo.reports").joinpath("page.css").read_text("utf-8")}',
        verdict=verdict if report.verdict else '',
        summary=escape(report.summary),
        replay=replay if flights else '',
        links=''.join(links),
        sections=''.join(map(_section, sections)),
    )


def _anchor(section: Section) -> str:
    return re.sub(r'[^a-z0-9]+', '-', section.title.lower()).strip('-')


def _section(section: Section) -> str:
    anchor, title = _anchor(section), escape(section.title)
    blocks = ''.join(map(_block, section.blocks))
    return f'<section id="{anchor}">\n<h2>{title}</h2>\n{blocks}</section>\n'


def _block(block: Block) -> str:
    match block:
        case Text(text):
            return f'<p>{escape(text)}</p>\n'
        case File(name, text):
            return (
                f'<details><summary>{escape(name)}</summary>'
                f'<pre><code>{escape(text)}</code></pre></details>\n'
            )
        case Fold(title, blocks):
            inside = ''.join(map(_block, blocks))
            return f'<details><summary>{escape(title)}</summary>{inside}</details>\n'
        case Picture():
            return (
                f'<figure><div class="drawing">{svg(block)}</div>'
                f'<figcaption>{escape(block.caption)}</figcaption></figure>\n'
            )
        case Table():
            heads = ''.join(f'<th scope="col">{escape(column)}</th>' for column in block.columns)
            return (
                f'<div class="table"><table><caption>{escape(block.caption)}</caption>'
                f'<thead><tr>{heads}</tr></thead><tbody>{"".join(_rows(block))}</tbody></table>'
                '</div>\n'
            )


def _rows(table: Table) -> Iterator[str]:
    for row in table.rows:
        if len(row) == 1:
            head = f'<th class="group" scope="rowgroup" colspan="{len(table.columns)}">'
            yield f'<tr>{head}{escape(row[0])}</th></tr>\n'
            continue
        head, *cells = row
        shown = ''.join(map(_cell, cells, table.columns[1:]))
        yield f'<tr><th scope="row">{escape(head)}</th>{shown}</tr>\n'


def _cell(text: str, column: str = '') -> str:
    """Return a cell; only in a column of verdicts is a word one, elsewhere it may be a name."""
    verdict = _VERDICTS.get(text) if column in ('', 'verdict') else ''
    look = verdict or ('number' if _NUMBER.match(text) and len(text) <= _LONGEST else '')
    return f'<td class="{look}">{escape(text)}</td>' if look else f'<td>{escape(text)}</td>'


def svg(picture: Picture) -> str:
    """Return a picture as inline SVG: colours by name, identifiers its own, no foreign address."""
    buffer = io.StringIO()
    with style.applied():
        _save(picture, buffer, format='svg', transparent=True, metadata={'Date': None})
    text = buffer.getvalue()
    text = text[text.index('<svg') :]
    text = re.sub(r'<metadata>.*?</metadata>', '', text, flags=re.DOTALL)
    numbers: dict[str, int] = {}

    def of_tag(tag: str) -> str:
        tag = re.sub('#[0-9a-f]{6}', _named, tag)
        tag = re.sub(
            r'( id="|xlink:href="#|url\(#)([^")]+)',
            lambda m: f'{m[1]}{picture.name}-{numbers.setdefault(m[2], len(numbers))}',
            tag,
        )
        tag = re.sub(r'\s*\n\s*', '\n', tag)
        return re.sub(r' d="[^"]*"', lambda d: re.sub(r'(\.\d\d)\d+', r'\1', d.group()), tag)

    def between(match: re.Match[str]) -> str:
        """Return a tag, or what is between two; indentation is one end of line."""
        text = match[0]
        return of_tag(text) if match[1] else text if text.strip() else '\n' * ('\n' in text)

    # Names are between tags, where < and > are escaped: no pattern for tags may match them.
    text = re.sub(r'(<[^>]*>)|[^<]+', between, text)
    box = re.search(r'viewBox="[^"]+"', text)
    body = text[text.index('>') + 1 :]
    return (
        f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" {box.group() if box else ""} '
        f'role="img" aria-label="{escape(picture.alt)}">{body}'
    )


def _named(match: re.Match[str]) -> str:
    colour = match.group()
    if colour not in style.NAMES:
        raise ValueError(f'{colour} is no colour of rpo_log.show.style')
    return f'var(--{style.NAMES[colour]})'


Subject = Literal['run', 'campaign', 'proof', 'controller']


def subject_of(target: str) -> Subject:
    """Return what a folder, a file or a name is: a controller, if nothing else.

    Raises InputError if it is a folder of neither a run nor a campaign nor a proof.
    """
    if target.endswith(('.mcap', '.db3')):
        return 'run'
    if not os.path.isdir(target):  # unlike Path's, never raises on odd names
        return 'controller'
    folder = Path(target)
    if log_files(folder) or bag_at(folder):
        return 'run'
    subjects: tuple[Subject, ...] = ('campaign', 'proof')
    for subject in subjects:
        if (folder / f'{subject}.yaml').is_file():
            return subject
    raise InputError(
        f'{target}: must be the folder of a run (it holds run.mcap, or is a bag), of a campaign '
        '(campaign.yaml) or of a proof (proof.yaml); of a training, give the .yaml of its '
        'controller'
    )
