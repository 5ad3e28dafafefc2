# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How every picture looks: one palette, in a light and a dark form, and matplotlib's settings.

The hues are Okabe and Ito's (*Color Universal Design*, 2008), which colour-blind readers tell
apart. Pictures are drawn in the light form; where a page follows the reader's theme, each colour is
looked up by name (`NAMES`), so a picture may use no colour that is not here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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


COLOURS = {
    'paper': ('#ffffff', '#14161a'),
    'ink': ('#1c1d20', '#e3e5e9'),
    'muted': ('#5b6068', '#a2a8b2'),
    'grid': ('#e4e6ea', '#32363e'),
    'x': ('#0072b2', '#56b4e9'),
    'y': ('#d55e00', '#f58a42'),
    'z': ('#009e73', '#3ccba2'),
    'good': ('#00724f', '#45d0a8'),
    'bad': ('#b04a00', '#ff9a57'),
    'optimum': ('#b0528a', '#e08fc0'),
    'small_negative': ('#57b5e9', '#a8dbf7'),
    'small_positive': ('#e69f00', '#f2c55c'),
}
"""Name -> (light, dark)."""
COLOURS.update(
    (f'shade_{i}', pair)
    for i, pair in enumerate(
        zip(
            _shades('#3f94c6', '#f4f4f5', '#e07f38'),
            _shades('#2f7fae', '#1d2026', '#b9602a'),
            strict=True,
        )
    )
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
    'figure.facecolor': LIGHT['paper'],
    'savefig.facecolor': LIGHT['paper'],
    'axes.facecolor': 'none',
    'axes.edgecolor': LIGHT['muted'],
    'axes.labelcolor': LIGHT['ink'],
    'axes.titlecolor': LIGHT['ink'],
    'axes.titlesize': 10.0,
    'axes.labelsize': 10.0,
    'axes.linewidth': 0.8,
    'axes.grid': True,
    'axes.axisbelow': True,
    'axes.formatter.useoffset': False,
    'axes.prop_cycle': f'cycler(color={list(AXES)})',
    'font.size': 10.0,
    'font.family': 'sans-serif',
    'font.sans-serif': ['DejaVu Sans', 'Verdana', 'Helvetica', 'Arial'],
    'grid.color': LIGHT['grid'],
    'grid.linewidth': 0.8,
    'legend.frameon': False,
    'legend.fontsize': 9.0,
    'legend.labelcolor': LIGHT['ink'],
    'lines.linewidth': 1.5,
    'text.color': LIGHT['ink'],
    'text.parse_math': False,  # a name may hold dollars
    'xtick.color': LIGHT['muted'],
    'ytick.color': LIGHT['muted'],
    'xtick.labelcolor': LIGHT['ink'],
    'ytick.labelcolor': LIGHT['ink'],
    'xtick.labelsize': 9.0,
    'ytick.labelsize': 9.0,
    'svg.fonttype': 'none',  # text stays text: to be read aloud, searched, copied
    'svg.hashsalt': 'rpo',  # the same picture has the same bytes
    'savefig.dpi': 130,
}


def applied() -> Any:
    """Return a context in which matplotlib draws and saves in this style."""
    import matplotlib

    return matplotlib.rc_context(_SETTINGS)


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

    class Plain(LogFormatter):  # which ticks have a label, it knows
        def __call__(self, x: float, pos: int | None = None) -> str:
            return f'{x:g}' if super().__call__(x, pos) else ''

    if x:
        axes.set_xscale('log')
    if y:
        axes.set_yscale('log')
    for axis in (axes.xaxis,) * x + (axes.yaxis,) * y:
        axis.set_major_formatter(Plain())
        axis.set_minor_formatter(Plain(labelOnlyBase=False))


_AROUND = ((1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1), (0, -1))
_DISTANCES_PT, _MARK_PT = (5.0, 12.0, 22.0, 36.0), 4.0


def label_points(axes: Any, points: Sequence[tuple[float, float, str]], avoid: Any = ()) -> None:
    """Name points where their names hide no point, no other name, and nothing of `avoid`.

    The names of crowded points are placed first, each at the first of some places around its point
    that hides nothing, or else at that which hides least; far from it, a line leads there. The
    limits of the axes must be final.

    points : (x, y, name); avoid : (n, 2) more points, both in the coordinates of the data
    """
    from matplotlib.transforms import Bbox

    if not points:
        return
    axes.figure.draw_without_rendering()
    pixel, frame = axes.figure.dpi / 72.0, axes.get_window_extent()
    spots = axes.transData.transform([*(p[:2] for p in points), *avoid])
    taken = [Bbox([spot - _MARK_PT * pixel, spot + _MARK_PT * pixel]) for spot in spots]

    def crowd(i: int) -> float:
        """Sum of the nearness of the other points."""
        return float(sum(1.0 / (1.0 + sum((spot - spots[i]) ** 2)) for spot in spots))

    def hidden(box: Any) -> float:
        """Area that a name at a box would hide, or that the frame would cut."""
        both = (Bbox.intersection(box, other) for other in taken)
        inside = Bbox.intersection(box, frame)
        cut = box.width * box.height - (inside.width * inside.height if inside else 0.0)
        return float(sum(b.width * b.height for b in both if b) + cut)

    for i in sorted(range(len(points)), key=lambda i: (-crowd(i), i)):
        line = {'arrowstyle': '-', 'linewidth': 0.6, 'color': LIGHT['muted'], 'shrinkB': _MARK_PT}
        name = axes.annotate(
            points[i][2], points[i][:2], (0, 0), textcoords='offset points', ha='center',
            va='center', arrowprops={**line, 'shrinkA': 0.0},
        )  # fmt: skip
        size = name.get_window_extent()
        found: list[tuple[float, int, tuple[float, float], Any, float]] = []
        for far in _DISTANCES_PT:
            for x, y in _AROUND:
                shift = (
                    x * (size.width / 2.0 + far * pixel),
                    y * (size.height / 2.0 + far * pixel),
                )
                box = Bbox.from_bounds(
                    spots[i][0] + shift[0] - size.width / 2.0,
                    spots[i][1] + shift[1] - size.height / 2.0,
                    size.width,
                    size.height,
                )
                found.append((hidden(box), len(found), shift, box, far))
        _, _, shift, box, far = min(found)
        name.set_position((shift[0] / pixel, shift[1] / pixel))
        name.arrow_patch.set_visible(far > _DISTANCES_PT[0])
        taken.append(box)


def legend_below(figure: Any, *axes: Any, columns: int = 6) -> None:
    """Put one legend of what some axes show below the figure, where it hides no data."""
    found: dict[str, Any] = {}
    for part in axes:
        for handle, label in zip(*part.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(found.values(), found.keys(), loc='outside lower center', ncols=columns)
