"""Cells of the validation table that stay empty, and why."""

ABSENT: tuple[tuple[str, str, str], ...] = ()
