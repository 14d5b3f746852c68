"""What studies have in common: their command line, rows as JSON, figures, progress."""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path

import matplotlib
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

HOME = Path(__file__).parents[1]


def parser(doc: str) -> argparse.ArgumentParser:
    """A command line that says what the first line of ``doc`` does, and takes a folder for the
    results."""
    found = argparse.ArgumentParser(description=doc.splitlines()[0])
    found.add_argument(
        "--results", type=Path, default=HOME / "results", help="folder for the results"
    )
    return found


def chosen(of: argparse.ArgumentParser, arguments: list[str] | None) -> argparse.Namespace:
    """What was chosen; the folder for the results is there."""
    found = of.parse_args(arguments)
    found.results.mkdir(parents=True, exist_ok=True)
    return found


def rounded(value, digits: int, but=()):
    """The same with so many digits, except below the keys ``but``; what is no finite number is
    None."""
    if isinstance(value, dict):
        return {k: v if k in but else rounded(v, digits, but) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(item, digits, but) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if np.isfinite(value) else None
    return value


def write(path: Path, whole: list | dict) -> None:
    """Write JSON with a line for each item of a list, anew, or leave the file as it was."""

    def listed(value) -> str:
        return "[\n" + ",\n".join(json.dumps(item, ensure_ascii=False) for item in value) + "\n]"

    def text(value) -> str:
        return listed(value) if isinstance(value, list) else json.dumps(value, ensure_ascii=False)

    if isinstance(whole, dict):
        whole = "{" + ",\n".join(f'"{key}": {text(value)}' for key, value in whole.items()) + "}"
    else:
        whole = listed(whole)
    part = path.with_suffix(".part")
    part.write_text(whole + "\n")
    part.replace(path)


def subplots(*shape: int, **options):
    """A figure and its axes, as ``matplotlib.pyplot.subplots`` makes them, to be saved."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt.subplots(*shape, layout="constrained", **options)


def save(figure, path: Path, dpi: int = 150, **options) -> None:
    """Save a figure and close it; ``options`` of ``savefig``."""
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi, **options)
    plt.close(figure)


def progress(console: Console, width: int) -> Progress:
    """A bar beside a description of so many letters."""
    return Progress(
        TextColumn(f"{{task.description:{width}}}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )


def commit(*command: str) -> str:
    """What git says of the commit, such as of ``describe``."""
    done = subprocess.run(["git", *command], cwd=HOME, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def dolfinx() -> str:
    """The version of DOLFINx."""
    from dolfinx import __version__

    return __version__
