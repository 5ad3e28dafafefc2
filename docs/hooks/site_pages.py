# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hooks of MkDocs: pages of the nodes, equations as MathML, links that leave docs/, the navigation.

The pages also serve readers on a Git forge, with `$...$` for an equation and `../ros_ws/...` for a
link. Here equations become MathML, which browsers draw without a script, and a link to a source
file becomes its text.
"""

from __future__ import annotations

import html
import logging
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert

ROOT = Path(__file__).resolve().parents[2]
log = logging.getLogger('mkdocs.hooks.pages')  # a warning ends a strict build

_EQUATION = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\[(\[](?P<latex>.*?)\\[)\]]</(?P=tag)>', re.S
)
_LINK = re.compile(r'(?<!!)\[(?P<text>[^\]]+)\]\((?P<target>[^)#:\s]+)(?:#[^)]*)?\)')


def on_config(config: Any) -> Any:
    """Write the pages of the nodes; replace a folder in the navigation by its pages."""
    docs = Path(config['docs_dir'])
    program = Path(__file__).with_name('node_pages.py')
    subprocess.run([sys.executable, program, docs / 'nodes'], check=True, stdout=subprocess.DEVNULL)
    nav = []
    for entry in config['nav']:
        (title, target), *_ = entry.items() if isinstance(entry, dict) else [('', entry)]
        if isinstance(target, str) and target.endswith('/'):
            found = sorted(docs.glob(f'{target}*.md'), key=lambda at: (at.stem != 'index', at))
            if found:
                nav.append({title: [path.relative_to(docs).as_posix() for path in found]})
        else:
            nav.append(entry)
    config['nav'] = nav
    return config


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Replace links to files outside docs/ by their text; warn of broken links."""
    folder = Path(page.file.abs_src_path).parent

    def replace(match: re.Match[str]) -> str:
        target = (folder / match['target']).resolve()
        if target.is_relative_to(ROOT / 'docs'):
            return match[0]
        if not target.exists():
            log.warning('%s: the link %s is broken', page.file.src_path, match['target'])
        where = target.relative_to(ROOT).as_posix() if target.is_relative_to(ROOT) else ''
        return f'{match["text"]} (`{where}`)' if where not in match['text'] else match['text']

    return _LINK.sub(replace, markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Draw the equations."""

    def replace(match: re.Match[str]) -> str:
        display = 'block' if match['tag'] == 'div' else 'inline'
        return convert(html.unescape(match['latex']).strip(), display=display)

    return _EQUATION.sub(replace, content)
