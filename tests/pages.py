"""Pages of Markdown, held to what they show: their Python is run, their shell lines are checked.

The blocks ```` ```python ```` of a page are run in order, in one namespace and in a folder that is
empty at the start.  A block ```` ```text ```` directly after one is exactly what it prints; a
warning of the package counts as a line printed, ``UserWarning: ...``.  The lines of
```` ```sh ```` name targets, packages, extras and files that exist.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tomllib
import types
import warnings
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from test_ranks import environment

HOME = Path(__file__).parents[1]
LANGUAGES = "python", "text", "sh", ""
AROUND = "make", "gcc", "python3-venv", "python3-dolfinx-real", "python3-pytest-benchmark"
CONDA = "python", "fenics-dolfinx", "mpich", "openmpi", "petsc", "petsc4py", "mpi4py", "make"


@dataclass(frozen=True)
class Block:
    """One fenced block: its ``language``, its ``source``, the number of its first line and whether
    nothing but blank lines is between it and the block before."""

    language: str
    source: str
    line: int
    directly: bool


def blocks(text: str, first: int = 1) -> list[Block]:
    """The fenced blocks of a page whose first line has this number, in order, those within
    directives too.

    Raises ``ValueError`` for a block that does not end.
    """
    found: list[Block] = []
    fence, between = None, True
    for number, line in enumerate(text.splitlines(), first):
        mark = re.match(r"\s*(`{3,})\s*(.*?)\s*$", line)
        if fence is None and mark:
            fence, language, start, inside = mark[1], mark[2], number + 1, []
        elif fence is None:
            between = between and not line.strip()
        elif mark and mark[1].startswith(fence) and not mark[2]:
            source = "\n".join(inside)
            found.append(Block(language, source, start, between))
            if language.startswith("{"):
                found += blocks(source, start)
            fence, between = None, True
        else:
            inside.append(line)
    if fence is not None:
        raise ValueError(f"the block of line {start - 1} does not end")
    return found


def _printed(source: str, page: Path, line: int, namespace: dict) -> str:
    """What a block prints, and what the package warns of while it runs."""
    inside = str(HOME / "mpm_fenicsx")
    out = io.StringIO()

    def show(message, category, filename, *_):
        if filename == str(page) or filename.startswith(inside):
            print(f"{category.__name__}: {message}", file=out)

    code = compile("\n" * (line - 1) + source, str(page), "exec")
    with warnings.catch_warnings(), contextlib.redirect_stdout(out):
        warnings.simplefilter("always")
        warnings.showwarning = show
        exec(code, namespace)
    return out.getvalue()


def _same(text: str) -> list[str]:
    return [line.rstrip() for line in text.strip().splitlines()]


def run(page: Path, folder: Path, monkeypatch) -> None:
    """Run a page in a folder, and check its shell lines.

    Raises ``AssertionError`` where it prints anything else than the page shows, or names what is
    not there.
    """
    monkeypatch.chdir(folder)
    for name in set(os.environ) - set(environment()):  # what MPI told this process about itself
        monkeypatch.delenv(name)
    for name, value in environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setenv(
        "PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    )
    module = types.ModuleType("page_" + re.sub(r"\W", "_", page.stem))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    shown = blocks(page.read_text())
    for block, after in zip_longest(shown, shown[1:]):
        place = f"{page.relative_to(HOME)}, line {block.line}"
        if block.language == "python":
            printed = _printed(block.source, page, block.line, vars(module))
            follows = after is not None and after.language == "text" and after.directly
            text = after.source if follows else ""
            assert _same(printed) == _same(text), f"{place}: it prints\n{printed}"
        elif block.language == "sh":
            for line in lines(block.source):
                wrong = check(line, folder)
                assert not wrong, f"{place}: {line}: {wrong}"
        else:
            known = block.language in LANGUAGES or block.language.startswith("{")
            assert known, f"{place}: {block.language!r} is none of {LANGUAGES}, so nobody runs it"
            assert not block.language.startswith("{code"), f"{place}: use ```python, which is run"


def lines(source: str) -> list[str]:
    """The commands of a shell block, without comments."""
    joined = source.replace("\\\n", " ")
    cut = [re.sub(r"(^|\s)#.*", "", line).strip() for line in joined.splitlines()]
    return [line for line in cut if line]


def apt_packages() -> list[str]:
    """What scripts/setup.sh asks for where Debian's DOLFINx is used."""
    command = ["sh", str(HOME / "scripts" / "setup.sh"), "apt-packages"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()


def check(line: str, folder: Path) -> str:
    """What is wrong with a shell line, or nothing."""
    words = shlex.split(line)
    while words and (words[0] == "sudo" or re.match(r"[A-Z_]+=", words[0])):
        words = words[1:]
    if words[:1] == ["mpiexec"]:
        words = words[words.index("-n") + 2 :]
    if words[1:3] == ["-m", "pip"]:
        words = words[2:]
    program, rest = (words[0], words[1:]) if words else ("", [])
    named = [word for word in rest if not word.startswith("-")]
    if Path(program).name in ("python", "python3", "sh", "paraview"):
        return _files(rest, folder)
    if program == "make":
        return _targets(rest)
    if program == "apt" and named[:1] == ["install"]:
        return _unknown(named[1:], [*apt_packages(), *AROUND])
    if program == "pip" and named[:1] == ["install"]:
        return _requirements(named[1:])
    if program == "conda":
        return _conda(named, rest)
    if program in ("cc", "gfortran"):
        return _sources(named, folder)
    return "" if program in ("cd", ".", "source") else "nobody checks this command"


def _unknown(names, known) -> str:
    return ", ".join(f"{name} is not asked for" for name in names if name not in known)


def _files(words, folder) -> str:
    if words[:1] == ["-m"] and words[1:2] != ["mpi4py"]:
        return "" if words[1] in ("venv", "pytest") else f"module {words[1]}"
    name = next((word for word in words if "." in word and not word.startswith("-")), None)
    there = name is None or (HOME / name).exists() or (folder / name).exists()
    return "" if there else f"there is no {name}"


def _sources(names, folder) -> str:
    sources = [name for name in names if name.endswith((".c", ".f", ".f90"))]
    missing = [n for n in sources if not (HOME / n).exists() and not (folder / n).exists()]
    return f"there is no {', '.join(missing)}" if missing else ""


def _targets(words) -> str:
    makefile = (HOME / "Makefile").read_text()
    targets = re.findall(r"^([a-z-]+):(?!=)", makefile, re.MULTILINE)
    variables = ["ARGS", "DOLFINX", "JOBS", "PYTHON", "SYSTEM_PYTHON"]
    named = [word.split("=")[0] for word in words]
    return _unknown([n for n in named if n not in variables], targets)


def _requirements(words) -> str:
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    needed = [*project["dependencies"], *(one for of in extras.values() for one in of)]
    for word in words:
        name, _, chosen = word.rstrip("]").partition("[")
        if name not in (".", "mpm_fenicsx") and word not in needed:
            return f"{word} is in no list of pyproject.toml"
        wrong = _unknown([one for one in chosen.split(",") if one], extras)
        if wrong:
            return wrong
    return ""


def _conda(named, rest) -> str:
    if "-f" in rest:
        name = rest[rest.index("-f") + 1]
        return "" if (HOME / name).exists() else f"there is no {name}"
    if named[:1] == ["activate"]:
        return ""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    names = [re.split(r"[^\w.-]", word)[0] for word in named[1:] if word != "conda-forge"]
    names = [name for name in names if f"-n {name}" not in " ".join(rest)]
    tests = [re.split(r"[^\w-]", one)[0] for one in project["optional-dependencies"]["test"]]
    return _unknown(names, [*project["dependencies"], *tests, *CONDA])
