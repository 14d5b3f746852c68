"""results/validation.json and its table: ``python tests/validation/table.py`` prints Markdown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

FILE = Path(__file__).parents[2] / "results" / "validation.json"
ORDER = ("FE", "MPM", "GIMP", "CMPM", "DM", "DM-G", "DM-C", "DM-GC", "DM-GCL")


def read(file: Path = FILE) -> list[dict]:
    """Rows of an earlier session."""
    return json.loads(file.read_text()) if file.exists() else []


def merge(new: list[dict], file: Path = FILE) -> list[dict]:
    """Replace the rows of the same case and mapping, keep the others, and write them all, in order of the cases."""
    rows = {(row["case"], row["mapping"]): row for row in read(file) + new}
    found = sorted(rows.values(), key=lambda row: (_number(row["case"]), row["case"], _place(row["mapping"])))
    file.write_text("[\n" + ",\n".join(json.dumps(row, ensure_ascii=False) for row in found) + "\n]\n")
    return found


def markdown(rows: list[dict]) -> str:
    """One row a case, one column a mapping: the error, and a letter for the stated reason where it is a failure."""
    names = sorted({row["mapping"] for row in rows}, key=_place)
    reasons = list(dict.fromkeys(row["note"] for row in rows if row["note"]))
    lines = ["| case | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for case in dict.fromkeys(row["case"] for row in rows):
        cells = {row["mapping"]: _cell(row, reasons) for row in rows if row["case"] == case}
        lines.append(f"| {case} | " + " | ".join(cells.get(name, "") for name in names) + " |")
    return "\n".join(lines + [""] + [f"({_letter(i)}) {reason}  " for i, reason in enumerate(reasons)])


def _cell(row: dict, reasons: list[str]) -> str:
    error = row["error"]
    text = "∞" if error is None else f"{error:.0e}" if 0.0 < error < 1e-5 else f"{100 * error:.2g} %"
    if error is not None and error >= 0.995:
        text = f"> {min(10 ** int(np.log10(error) + 1e-9), 1000):.0f}00 %"
    return f"**{row['result']}** {text}" if row["result"] == "FAILED" else \
        f"{text} ({_letter(reasons.index(row['note']))})" if row["note"] else text


def _letter(i: int) -> str:
    return chr(ord("a") + i) if i < 26 else _letter(i // 26 - 1) + _letter(i % 26)


def _number(case: str) -> int:
    digits = case.split(" ")[0].rstrip(".:")
    return int(digits) if digits.isdigit() else 99


def _place(mapping: str) -> tuple[int, str]:
    return (ORDER.index(mapping) if mapping in ORDER else len(ORDER), mapping)


if __name__ == "__main__":
    print(markdown(read()))
