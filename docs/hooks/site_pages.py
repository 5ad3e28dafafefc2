# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hooks of MkDocs: pages of nodes and notebooks, equations, links that leave docs/, navigation.

The pages also serve readers on a Git forge, with `$...$` for an equation and `../ros_ws/...` for a
link. Here equations become MathML, which browsers draw without a script, and a link to a source
file becomes its text. A notebook becomes a page, with its stored outputs.
"""

from __future__ import annotations

import base64
import html
import json
import logging
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
_COMMENT = re.compile(r'<!--.*?-->\s*', re.S)
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
    config['nav'] = list(_with_folders(config['nav'], docs))
    return config


def _with_folders(nav: list[Any], docs: Path) -> Iterator[Any]:
    """Yield the entries of a navigation; the name of a folder becomes its pages."""
    for entry in nav:
        (title, target), *_ = entry.items() if isinstance(entry, dict) else [('', entry)]
        if isinstance(target, list):
            yield {title: list(_with_folders(target, docs))}
        elif target.endswith('/'):
            pages = sorted(docs.glob(f'{target}*.md'), key=lambda at: (at.stem != 'index', at))
            yield {title: [path.relative_to(docs).as_posix() for path in pages]}
        else:
            yield entry


def on_files(files: Any, config: Any) -> Any:
    """Add a page and the pictures of each notebook."""
    docs = Path(config['docs_dir'])
    for path in docs.rglob('*.ipynb'):
        page, pictures = notebook_page(path)
        for name, content in {f'{path.stem}.md': page, **pictures}.items():
            where = path.relative_to(docs).with_name(name).as_posix()
            files.append(File.generated(config, where, content=content))
    return files


def notebook_page(path: Path) -> tuple[str, dict[str, bytes]]:
    """Return a notebook as Markdown, and the pictures that its cells drew: name -> PNG."""
    parts, pictures = list[str](), dict[str, bytes]()
    for cell in json.loads(path.read_text())['cells']:
        source = ''.join(cell['source'])
        is_text = cell['cell_type'] == 'markdown'
        parts.append(_COMMENT.sub('', source) if is_text else f'```python\n{source}\n```')
        for output in cell.get('outputs', ()):
            data = output.get('data', {'text/plain': output.get('text', '')})
            if 'image/png' in data:
                name = f'{path.stem}_{len(pictures) + 1}.png'
                pictures[name] = base64.b64decode(data['image/png'])
                parts.append(f'![What the cell draws]({name})')
            elif 'text/html' in data:
                parts.append(''.join(data['text/html']))
            else:
                parts.append(f'```text\n{"".join(data["text/plain"]).rstrip()}\n```')
    return '\n\n'.join(parts), pictures


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Replace links to files outside docs/ by their text; warn of broken links."""
    folder = ROOT / 'docs' / Path(page.file.src_path).parent

    def replace(match: re.Match[str]) -> str:
        target = (folder / match['target']).resolve()
        if target.is_relative_to(ROOT / 'docs'):
            return match[0].replace('.ipynb', '.md')
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
