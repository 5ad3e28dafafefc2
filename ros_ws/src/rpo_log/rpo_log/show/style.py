# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How every picture looks: one palette, in a light and a dark form, and matplotlib's settings.

The hues are Okabe and Ito's (*Color Universal Design*, 2008), which colour-blind readers tell
apart. Pictures are drawn in the light form; where a page follows the reader's theme, each colour is
looked up by name (`NAMES`), so a picture may use no colour that is not in `style.yaml`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rpo_core import files
from rpo_core.files.output import write_aside

AXIS_NAMES = ('x (R-bar)', 'y (V-bar)', 'z (H-bar)')
SHADES = 13
"""Steps of the scale from the most negative force to the most positive."""

_MARGIN = 0.012
WIDTH_IN = 9.0
"""Width of a picture; printed on A4 its text is then about 7 pt."""


def _mixed(a: str, b: str, share: float) -> str:
    """Return the colour `share` of the way from a to b."""
    pairs = zip(bytes.fromhex(a[1:]), bytes.fromhex(b[1:]), strict=True)
    return '#' + bytes(round(p + share * (q - p)) for p, q in pairs).hex()


def _shades(negative: str, zero: str, positive: str) -> list[str]:
    half = SHADES // 2
    below = [_mixed(negative, zero, i / half) for i in range(half)]
    return [*below, zero, *(_mixed(zero, positive, (i + 1) / half) for i in range(half))]


_WRITTEN = files.parse_yaml(Path(__file__).with_suffix('.yaml').read_text(encoding='utf-8'))

COLOURS: dict[str, tuple[str, str]] = {n: (a, b) for n, (a, b) in _WRITTEN['colours'].items()}
"""Name -> (light, dark)."""
COLOURS.update(
    (f'shade_{i}', pair)
    for i, pair in enumerate(zip(*(_shades(*ends) for ends in _WRITTEN['shades']), strict=True))
)

LIGHT = {name: light for name, (light, _) in COLOURS.items()}
NAMES = {light: name for name, light in LIGHT.items()}
"""Light colour -> name."""

AXES = (LIGHT['x'], LIGHT['y'], LIGHT['z'])
WORDS = tuple(LIGHT[n] for n in ('x', 'small_negative', 'muted', 'small_positive', 'y'))
"""Colours of LN, SN, Z, SP, LP."""
SCALE = tuple(LIGHT[f'shade_{i}'] for i in range(SHADES))
LIMIT = {'color': LIGHT['ink'], 'linestyle': (0, (4, 3)), 'linewidth': 1.0}
"""How the line of a limit is drawn."""

_SETTINGS: dict[str, Any] = {
    key: LIGHT.get(value, value) if isinstance(value, str) else value
    for key, value in _WRITTEN['settings'].items()
} | {'axes.prop_cycle': f'cycler(color={list(AXES)})'}


def variables() -> str:
    """Return the palette as CSS variables, for a light and a dark theme; paper is light."""
    light, dark = (
        ''.join(f'--{name}:{pair[i]};' for name, pair in COLOURS.items()) for i in (0, 1)
    )
    return f':root{{{light}}}\n@media screen and (prefers-color-scheme: dark){{:root{{{dark}}}}}'


def applied() -> Any:
    """Return a context in which matplotlib draws and saves in this style."""
    import matplotlib

    return matplotlib.rc_context(_SETTINGS)


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure, whole or not at all; its suffix is the format. Raises InputError."""
    write_aside(path, lambda file: figure.savefig(file, format=path.suffix[1:] or 'png'))


def new_figure(height_in: float) -> Any:
    """Return an empty figure of full width that keeps its parts apart.

    A margin at both sides: a browser may draw a label in a wider font than the one measured here.
    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    layout = ConstrainedLayoutEngine(rect=(_MARGIN, 0.0, 1.0 - 2.0 * _MARGIN, 1.0))
    return Figure(figsize=(WIDTH_IN, height_in), layout=layout)


def new_panels(height_in: float, rows: int = 1, columns: int = 1, **options: Any) -> Any:
    """Return an empty figure and its axes; the options are those of `Figure.subplots`."""
    figure = new_figure(height_in)
    return figure, figure.subplots(rows, columns, **options)


def log_scale(axes: Any, *, x: bool = False, y: bool = True) -> None:
    """Make axes logarithmic, with plain numbers along them.

    matplotlib writes powers as mathtext, which these settings leave as it is (`text.parse_math`).
    """
    from matplotlib.ticker import LogFormatter

    class Plain(LogFormatter):
        """Plain numbers; its base knows which ticks have a label."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            return f'{x:g}' if super().__call__(x, pos) else ''

    if x:
        axes.set_xscale('log')
    if y:
        axes.set_yscale('log')
    for axis in (axes.xaxis,) * x + (axes.yaxis,) * y:
        axis.set_major_formatter(Plain())
        axis.set_minor_formatter(Plain(labelOnlyBase=False))


def legend_below(figure: Any, *axes: Any, columns: int = 6) -> None:
    """Put one legend of what some axes show below the figure, where it hides no data."""
    handles: dict[str, Any] = {}
    for part in axes:
        for handle, label in zip(*part.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), loc='outside lower center', ncols=columns)
