# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers along logarithmic axes are plain: pictures printed `$\\mathdefault{10^{2}}$`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from rpo.reports import training
from rpo_log.show import style


def texts(figure: Figure) -> list[str]:
    """Return the texts of a figure as they are drawn."""
    figure.draw_without_rendering()
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


@pytest.mark.parametrize(
    ('low', 'high', 'wanted'),
    [
        (3.97, 1e4, {'10', '100', '1000'}),
        (1e-6, 1e-1, {'1e-05', '0.01'}),
        (3.9, 4.2, {'3.9', '4', '4.2'}),  # less than a decade: the ticks between have labels
    ],
)
def test_a_logarithmic_scale_has_plain_numbers(low, high, wanted):
    with style.applied():
        figure, axes = style.new_panels(4.0)
        axes.plot([low, high], [low, high])
        style.log_scale(axes, x=True)
        assert not any(re.search(r'[$\\]', text) for text in texts(figure))
    for axis in (axes.xaxis, axes.yaxis):
        ticks = (*axis.get_major_ticks(), *axis.get_minor_ticks())
        assert wanted <= {tick.label1.get_text() for tick in ticks}


@pytest.fixture
def drawn(monkeypatch):
    """Return the figures that are saved: name -> figure."""
    found: dict[str, Figure] = {}

    def savefig(figure, file, **_):
        found[Path(getattr(file, 'name', file)).name.removeprefix('.').removesuffix('.new')] = (
            figure
        )

    monkeypatch.setattr(Figure, 'savefig', savefig)
    return found


@pytest.mark.every_landing
def test_pictures_of_a_training(tmp_path, drawn):
    columns = 'evaluations', 'mean_fitness', 'best_fitness', 'best_energy_n2s'
    rows = [(60 * k, 300.0 / k, 4.0 + 8.0 / k, 4.0 + 1.0 / k) for k in range(1, 9)]
    finalists = [(4.1 + 0.1 * k, 4.3 + 0.1 * k) for k in range(4)]
    for name, heads, table in (
        ('history.csv', columns, rows),
        ('finalists.csv', ('training_fitness', 'held_out_fitness'), finalists),
    ):
        lines = [','.join(heads), *(','.join(map(str, row)) for row in table)]
        (tmp_path / name).write_text('\n'.join(lines))
    training.draw_run(tmp_path)
    assert {'convergence.png', 'held_out.png'} <= set(drawn)
    for name, figure in drawn.items():
        assert not [text for text in texts(figure) if re.search(r'[$\\]', text)], name
    assert {'10', '100'} <= set(texts(drawn['convergence.png']))
