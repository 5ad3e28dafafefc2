# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Figures that a command puts into a page of the documentation, between two marks."""

from __future__ import annotations

from pathlib import Path

from rpo_training.ledger import write_aside

END = '<!-- end -->'


def put(page: Path, command: str, text: str) -> None:
    """Replace what stands between the mark of a command and END; a page without gets both."""
    begin = f'<!-- printed by `{command}` -->'
    page_text = page.read_text() if page.is_file() else ''
    if begin not in page_text:
        page_text = f'{page_text.rstrip()}\n\n{begin}\n{END}\n'.lstrip()
    before, _, rest = page_text.partition(begin)
    after = rest.partition(END)[2]
    content = f'{before}{begin}\n{text}{END}{after}'
    write_aside(page, lambda file: file.write(content.encode()))
