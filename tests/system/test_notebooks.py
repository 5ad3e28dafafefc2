# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The notebooks are valid, their cells run in order, and print what is stored with them."""

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
COURSE = [
    'fly_and_compare', 'understand_a_rule', 'train_your_own', 'disperse', 'make_it_safe',
    'turn_and_dock',
]  # fmt: skip
MARKS = {
    'disperse': pytest.mark.slow,
    'train_your_own': pytest.mark.slow,
    'turn_and_dock': pytest.mark.every_landing,
}
FLOWN = [pytest.param(path, marks=MARKS.get(path.stem, ())) for path in NOTEBOOKS]


def test_all_are_here_and_linked_in_the_order_of_the_course():
    assert [path.stem for path in NOTEBOOKS] == sorted(COURSE)
    assert re.findall(r'\]\((\w+)\.ipynb\)', (FOLDER / 'index.md').read_text()) == COURSE


@each_notebook
def test_it_has_the_form_of_nbformat_4_5_and_its_outputs(path):
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
    outputs = [out for cell in notebook['cells'] for out in cell.get('outputs', ())]
    assert any('image/png' in out.get('data', ()) for out in outputs)
    assert not {out['output_type'] for out in outputs} - {
        'stream',
        'display_data',
        'execute_result',
    }
    assert all(out.get('name', 'stdout') == 'stdout' for out in outputs)  # no warning
    counts = [c['execution_count'] for c in notebook['cells'] if c['cell_type'] == 'code']
    assert counts == list(range(1, len(counts) + 1))  # run once, from the top


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
        assert drawn and all(a.lines or a.patches for figure in drawn for a in figure.axes)
    finally:
        pyplot.close('all')
    said = capsys.readouterr().out
    if path.stem != 'train_your_own':  # whose budget is smaller here
        cells = json.loads(path.read_text())['cells']
        stored = (out.get('text', ()) for cell in cells for out in cell.get('outputs', ()))
        assert said == ''.join(line for text in stored for line in text)
    else:
        before, _, after = said.partition('controllers tried')
        assert 'MISSED' in before and after.count('limit') == before.count('limit') == 4
