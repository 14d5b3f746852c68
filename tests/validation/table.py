"""results/validation.json and its table: ``python tests/validation/table.py`` renews the one in
docs/verification.md."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
from absent import ABSENT

HOME = Path(__file__).parents[2]
FILE = HOME / "results" / "validation.json"
PAGE = HOME / "docs" / "verification.md"
PLACE = re.compile(r"(?<=</summary>\n\n).*?(?=\n\n</details>)", re.DOTALL)
"""Of the table in a page: what the first ``<details>`` folds away."""
ORDER = ("FE", "MPM", "GIMP", "CMPM", "DM", "DM-G", "DM-C", "DM-GC", "DM-GCL")


def read(file: Path = FILE) -> list[dict]:
    """Rows of an earlier session."""
    return json.loads(file.read_text()) if file.exists() else []


def merge(new: list[dict], file: Path = FILE, keep: bool = True) -> list[dict]:
    """Replace the rows of the same case and mapping, keep the others or not, and write them all, in
    order."""
    rows = {(row["case"], row["mapping"]): row for row in (read(file) if keep else []) + new}
    found = ordered(rows.values())
    file.write_text(
        "[\n" + ",\n".join(json.dumps(row, ensure_ascii=False) for row in found) + "\n]\n"
    )
    return found


def ordered(rows) -> list[dict]:
    """By number and name of the case, then by mapping."""
    return sorted(rows, key=lambda row: (_number(row["case"]), row["case"], _place(row["mapping"])))


def markdown(rows: list[dict]) -> str:
    """One row a case, one column a mapping: the error, or a dash where the case is not run; letters
    give reasons."""
    names = sorted({row["mapping"] for row in rows}, key=_place)
    reasons: list[str] = []
    lines = ["| case | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for case in dict.fromkeys(row["case"] for row in rows):
        here = {row["mapping"]: row for row in rows if row["case"] == case}
        cells = []
        for name in names:
            text, reason = _cell(here[name]) if name in here else _gap(case, name)
            if reason and reason not in reasons:
                reasons.append(reason)
            cells.append(f"{text} ({_letter(reasons.index(reason))})" if reason else text)
        lines.append(f"| {case} | " + " | ".join(cells) + " |")
    return "\n".join(
        lines + [""] + [f"({_letter(i)}) {reason}  " for i, reason in enumerate(reasons)]
    )


def shown(page: Path = PAGE) -> str:
    """The table that a page shows.  Raises ``ValueError`` where it has no place for one."""
    found = PLACE.search(page.read_text(encoding="utf-8"))
    if found is None:
        raise ValueError(f"{page} has no <details> with a <summary> for the table to go into")
    return found.group()


def show(rows: list[dict], page: Path = PAGE) -> None:
    """Put the table of rows in the place of the one that a page shows."""
    shown(page)
    text = PLACE.sub(lambda _: markdown(rows).rstrip(), page.read_text(encoding="utf-8"), count=1)
    page.write_text(text, encoding="utf-8")


def absent(case: str, mapping: str) -> str:
    """Why the mapping does not run the case; nothing where no reason is given."""
    return next(
        (
            why
            for start, mappings, why in ABSENT
            if case.startswith(start) and mapping in mappings.split()
        ),
        "",
    )


def blanks(rows: list[dict]) -> list[tuple[str, str]]:
    """Cells without an error and without a reason."""
    filled = {(row["case"], row["mapping"]) for row in rows}
    cells = [(case, name) for case in dict.fromkeys(row["case"] for row in rows) for name in ORDER]
    return [cell for cell in cells if cell not in filled and not absent(*cell)]


def _cell(row: dict) -> tuple[str, str]:
    error = row["error"]
    text = (
        "∞"
        if error is None
        else f"{error:.0e}"
        if 0.0 < error < 1e-5
        else f"{float(f'{100 * error:.2g}'):g} %"
    )
    if error is not None and error >= 1.0:
        text = f"> {min(10 ** int(np.log10(error) + 1e-9), 1000):.0f}00 %"
    return (f"**FAILED** {text}", "") if row["result"] == "FAILED" else (text, row["note"])


def _gap(case: str, mapping: str) -> tuple[str, str]:
    reason = absent(case, mapping)
    return ("–" if reason else "", reason)


def _letter(i: int) -> str:
    return chr(ord("a") + i) if i < 26 else _letter(i // 26 - 1) + _letter(i % 26)


def _number(case: str) -> int:
    digits = case.split(" ")[0].rstrip(".:")
    return int(digits) if digits.isdigit() else 99


def _place(mapping: str) -> tuple[int, str]:
    return (ORDER.index(mapping) if mapping in ORDER else len(ORDER), mapping)


if __name__ == "__main__":
    show(read())
