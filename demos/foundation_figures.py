"""The two figures of ``foundation.py``, from plain arrays."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm

COLOURS = {"fixed": "#0072B2", "viscous": "#E69F00", "viscoelastic": "#009E73"}
WIDTHS = {"fixed": 3.0, "viscous": 5.5, "viscoelastic": 2.2}  # the absorbing ones nearly coincide


def histories(curves, pressure, plateau, apart, depths, title, path):
    """Load, vertical stress at one point and deviatoric stress q at another, over time.

    ``curves``: (time, vertical stress, q, settlement) by method and boundary; ``pressure``: time
    and load; ``apart``: when fixed leaves viscous by a share of its largest q, or None; ``depths``
    of the points.
    """
    fig, axes = plt.subplots(
        3,
        1,
        figsize=(8.5, 8.5),
        sharex=True,
        layout="constrained",
        gridspec_kw={"height_ratios": (0.45, 1, 1)},
    )
    above, middle, below = axes
    t, p = pressure
    above.fill_between(t, p / 1e3, color="0.85")
    above.plot(t, p / 1e3, color="0.3", lw=1)
    for (method, boundary), (time, vertical, q, _) in curves.items():
        style = (
            {"lw": 0.9, "ls": (0, (5, 2))}
            if method == "FE"
            else {"lw": WIDTHS[boundary], "alpha": 0.55}
        )
        for ax, curve in ((middle, vertical), (below, q)):
            ax.plot(
                time, curve / 1e3, color=COLOURS[boundary], label=f"{boundary}, {method}", **style
            )
    below.axhline(plateau / 1e3, color="0.25", lw=0.9, ls=":")
    below.annotate(
        f"first yield, {plateau / 1e3:.1f} kPa",
        (0.01, plateau / 1e3),
        (0, -11),
        textcoords="offset points",
        fontsize=8,
        color="0.25",
    )
    lines = ["fixed leaves viscous by"]
    for share, when in apart.items():
        if when is not None:
            below.axvline(when, color="#CC79A7", lw=1)
            lines.append(f"{100 * share:g} % of max q at {when:g} s")
    if len(lines) > 1:
        below.annotate(
            "\n".join(lines),
            (max(filter(None, apart.values())), 11.0),
            (8, 0),
            textcoords="offset points",
            fontsize=8,
            color="#9A4A7A",
        )
    above.set(ylabel="pressure (kPa)", title="on the strip (assumed)", ylim=(0, None))
    middle.set(
        ylabel="vertical stress (kPa)",
        title=f"point 1: on the axis, {depths[0]:.2f} m deep (assumed)",
    )
    below.set(
        ylabel="deviatoric stress q (kPa)",
        title=f"point 2: on the axis, {depths[1]:.2f} m deep (assumed)",
        xlabel="time (s)",
        ylim=(0, None),
    )
    for ax in axes:
        ax.grid(alpha=0.3)
        ax.set_xlim(0, t[-1])
        ax.title.set_fontsize(10)
    middle.legend(loc="lower left", fontsize=9)
    fig.suptitle(title, fontsize=11)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def plastic_strain(ax, boxes, body, strip):
    """Boxes, lower corners (n, 2), sizes (n, 2) and plastic strain (n,), of a ``body``, width and
    height, and the ``strip`` on it, its ends; the collection."""
    corner, size, strain = boxes
    ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    shown = ax.add_collection(
        PolyCollection(
            corner[:, None] + size[:, None] * ring,
            array=np.maximum(strain, 1e-9),
            cmap=plt.get_cmap("magma_r").with_extremes(under="0.86"),
            norm=LogNorm(1e-3, 1.0),
            edgecolors="face",
            linewidths=0.2,
            rasterized=True,
        )
    )
    ax.plot(strip, 2 * [body[1] + 0.15], color="#0072B2", lw=3, solid_capstyle="butt")
    ax.set(aspect="equal", xlim=(-0.1, body[0] + 0.1), ylim=(-0.1, body[1] + 0.35))
    return shown


def name_axes(fig, axes, shown):
    """Units of maps, and what their colours are."""
    for ax in axes[-1]:
        ax.set_xlabel("x (m)")
    for ax in axes[:, 0]:
        ax.set_ylabel("y (m)")
    fig.colorbar(
        shown, ax=axes, extend="both", label="plastic strain κ (-), grey: below 0.001", shrink=0.8
    )


def maps(found, boundaries, body, strip, title, path):
    """Plastic strain: a column of maps a boundary, a row a method.

    ``found``: lower corners (n, 2), sizes (n, 2) and plastic strain (n,) of boxes by method and
    boundary; ``body``: its width and height; ``strip``: its ends.
    """
    methods = list(dict.fromkeys(method for method, _ in found))
    fig, axes = plt.subplots(
        len(methods),
        len(boundaries),
        figsize=(4 * len(boundaries), 2.9 * len(methods) + 0.8),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for (method, boundary), boxes in found.items():
        ax = axes[methods.index(method), boundaries.index(boundary)]
        shown = plastic_strain(ax, boxes, body, strip)
        ax.set_title(f"{boundary}, {method}")
    name_axes(fig, axes, shown)
    fig.suptitle(
        f"{title}\nmaterial points where they are then, elements undeformed; blue: strip as it was",
        fontsize=11,
    )
    fig.savefig(path, dpi=150)
    plt.close(fig)


def ground(histories, depth, title, path):
    """Deviatoric stress q, how far it is from the first one's, and settlement, over time.

    ``histories``: (time, q, settlement) by name; ``depth`` of the point of q.
    """
    fig, (above, middle, below) = plt.subplots(
        3,
        1,
        figsize=(8.5, 8.5),
        sharex=True,
        layout="constrained",
        gridspec_kw={"height_ratios": (1, 0.6, 1)},
    )
    first, every, _ = next(iter(histories.values()))
    styles = (
        ("#E69F00", 5.5, "-"),
        ("#0072B2", 2.0, "-"),
        ("#CC79A7", 3.5, "-"),
        ("0.15", 1.2, (0, (4, 2.5))),
    )
    for (name, (t, q, down)), (colour, wide, dashes) in zip(histories.items(), styles, strict=True):
        style = {"color": colour, "lw": wide, "ls": dashes, "label": name}
        n = min(len(first), len(t))
        above.plot(t, q / 1e3, **style)
        middle.plot(t[:n], 100 * (q[:n] - every[:n]) / every.max(), **style)
        below.plot(t, 1e3 * down, **style)
    above.set(
        ylabel="deviatoric stress q (kPa)",
        title=f"point 2: on the axis, {depth:.2f} m deep (assumed)",
        ylim=(0, None),
    )
    middle.set(ylabel="difference (%)", title="q less that of all points, of its largest value")
    below.set(ylabel="settlement (mm)", title="middle of the strip", xlabel="time (s)")
    for ax in (above, middle, below):
        ax.grid(alpha=0.3)
        ax.set_xlim(0, first[-1])
        ax.title.set_fontsize(10)
    above.legend(loc="upper left", fontsize=9)
    fig.suptitle(title, fontsize=11)
    fig.savefig(path, dpi=150)
    plt.close(fig)
