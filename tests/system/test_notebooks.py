# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The notebooks are valid, are stored without outputs, and their cells run in order."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / 'docs' / 'notebooks'
NOTEBOOKS = sorted(FOLDER.glob('*.ipynb'))
COMMON = {'cell_type', 'id', 'metadata', 'source'}
KEYS = {'markdown': COMMON, 'code': COMMON | {'execution_count', 'outputs'}}

each_notebook = pytest.mark.parametrize('path', NOTEBOOKS, ids=lambda path: path.stem)
FLOWN = [NOTEBOOKS[0], pytest.param(NOTEBOOKS[1], marks=pytest.mark.slow)]


def test_both_are_here_and_linked():
    assert [path.stem for path in NOTEBOOKS] == ['fly_and_compare', 'train_your_own']
    page = (FOLDER / 'index.md').read_text()
    assert all(f']({path.name})' in page for path in NOTEBOOKS)


@each_notebook
def test_it_has_the_form_of_nbformat_4_5_and_no_outputs(path):
    notebook = json.loads(path.read_text())
    assert set(notebook) == {'cells', 'metadata', 'nbformat', 'nbformat_minor'}
    assert (notebook['nbformat'], notebook['nbformat_minor']) == (4, 5)
    assert notebook['metadata']['kernelspec']['name'] == 'python3'
    names = [cell['id'] for cell in notebook['cells']]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r'[a-zA-Z0-9_-]{1,64}', name) for name in names)
    for cell in notebook['cells']:
        assert set(cell) == KEYS[cell['cell_type']]
        assert all(line.endswith('\n') for line in cell['source'][:-1])
        assert cell.get('execution_count') is None and not cell.get('outputs')


@each_notebook
def test_its_links_lead_somewhere(path):
    cells = json.loads(path.read_text())['cells']
    text = '\n'.join(''.join(c['source']) for c in cells if c['cell_type'] == 'markdown')
    assert 'SPDX-License-Identifier' in text
    for target in re.findall(r'\]\(([^)#:\s]+)', text):
        assert (path.parent / target).exists(), target


@pytest.mark.parametrize('path', FLOWN, ids=lambda path: path.stem)
def test_its_cells_run_in_order(path, monkeypatch, capsys):
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot

    monkeypatch.setenv('RPO_EVALUATIONS', '40')
    monkeypatch.setattr(pyplot, 'show', lambda: None)
    names: dict[str, object] = {'__name__': path.stem}
    try:
        with matplotlib.rc_context():
            for cell in json.loads(path.read_text())['cells']:
                if cell['cell_type'] == 'code':
                    source = ''.join(cell['source'])
                    exec(compile(source, f'{path.name} {cell["id"]}', 'exec'), names)
        drawn = [pyplot.figure(number) for number in pyplot.get_fignums()]
        assert drawn and all(axes.lines for figure in drawn for axes in figure.axes)
    finally:
        pyplot.close('all')
    said = capsys.readouterr().out
    if path.stem == 'fly_and_compare':
        assert re.search(r'^trained +meets every requirement$', said, re.MULTILINE)
    else:
        before, _, after = said.partition('controllers tried')
        assert 'MISSED' in before and after.count('limit') == before.count('limit') == 4
