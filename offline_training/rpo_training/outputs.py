# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Files that commands write: whole or not at all, and parts of pages between two markers."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import IO

from rpo_core.validation import InputError

END = '<!-- end -->'


def write_aside(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file beside `path` and rename it into place: the old one stays whole until then.

    Raises
    ------
    InputError
        If it cannot be written, as on a full disk; `path` is then as it was.
    """
    aside = path.with_name(f'.{path.name}.new')
    try:
        with aside.open('wb') as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
    except BaseException as error:
        aside.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f'{path}: cannot be saved: {error.strerror or error}') from None
        raise


def put(page: Path, command: str, text: str) -> None:
    """Replace what stands between the marker of a command and END; a page without gets both."""
    begin = f'<!-- printed by `{command}` -->'
    page_text = page.read_text() if page.is_file() else ''
    if begin not in page_text:
        page_text = f'{page_text.rstrip()}\n\n{begin}\n{END}\n'.lstrip()
    before, _, rest = page_text.partition(begin)
    after = rest.partition(END)[2]
    content = f'{before}{begin}\n{text}{END}{after}'
    write_aside(page, lambda file: file.write(content.encode()))
