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


@pytest.mark.parametrize('path', NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_run_from_the_top_without_a_warning_and_its_links_lead_somewhere(path):
    notebook = json.loads(path.read_text())
    cells = notebook['cells']
    assert notebook['metadata']['kernelspec']['name'] == 'python3'
    outputs = [out for cell in cells for out in cell.get('outputs', ())]
    assert any('image/png' in out.get('data', ()) for out in outputs)
    assert all(out['output_type'] != 'error' for out in outputs)
    assert all(out.get('name', 'stdout') == 'stdout' for out in outputs)
    counts = [cell['execution_count'] for cell in cells if cell['cell_type'] == 'code']
    assert counts == list(range(1, len(counts) + 1))
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
    pyplot.close('all')  # of other tests
    names: dict[str, object] = {'__name__': path.stem}
    try:
        with matplotlib.rc_context():
            for cell in json.loads(path.read_text())['cells']:
                if cell['cell_type'] == 'code':
                    source = ''.join(cell['source'])
                    exec(compile(source, f'{path.name} {cell["id"]}', 'exec'), names)
        drawn = [pyplot.figure(number) for number in pyplot.get_fignums()]
        assert drawn and all(a.has_data() for figure in drawn for a in figure.axes)
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
