"""What is handed on: a source distribution that is whole, a wheel that is the package, and files
for conda, git and CI that say the same as ``pyproject.toml``."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

import mpm_fenicsx

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
EXTRAS = PROJECT["project"]["optional-dependencies"]
VERSION = mpm_fenicsx.__version__
WITH_DOLFINX = {"dolfinx", "ufl", "basix", "ffcx", "cffi", "mpi4py", "petsc4py"}
"""Modules that DOLFINx's packages bring along."""
LEFT = (
    ".venv/bin/python",
    "build/lib/mpm_fenicsx/gone.py",
    "demos/column.checkpoint",
    "docs/_build/html/index.html",
    "docs/gallery/column.rst",
    "docs/sg_execution_times.rst",
    "mpm_fenicsx/grid/__pycache__/cells.walk-1.py313.nbi",
    "results/column_000001.vtu",
    "tests/__pycache__/hats.cpython-313.pyc",
)
"""What work leaves behind, and git ignores."""


def tracked():
    """Files that git has, by their paths from the root."""

    def git(*words):
        return subprocess.run(
            ["git", "-C", ROOT, *words], capture_output=True, text=True, check=True
        ).stdout

    try:
        top = git("rev-parse", "--show-toplevel").rstrip("\n")
    except (OSError, subprocess.CalledProcessError):
        top = None
    if top is None or not ROOT.samefile(top):
        pytest.skip(f"{ROOT} is no git checkout: nothing says which files there should be")
    return {name for name in git("ls-files", "-z").split("\0") if name and (ROOT / name).exists()}


def build(source, kind, to):
    """The file that the build backend makes of a folder: ``kind`` is sdist or wheel."""
    program = f"from setuptools import build_meta\nbuild_meta.build_{kind}({str(to)!r})"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=source, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    (made,) = to.iterdir()
    return made


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The source distribution of what git has, unpacked; work has left something behind."""
    setuptools = pytest.importorskip("setuptools")
    if int(setuptools.__version__.split(".")[0]) < 77:
        pytest.skip(f"setuptools {setuptools.__version__} does not read this pyproject.toml")
    source, made, to = (tmp_path_factory.mktemp(name) for name in ("source", "sdist", "unpacked"))
    for name in tracked():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    for name in LEFT:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text("left")
    subprocess.run(["tar", "-xzf", build(source, "sdist", made), "-C", to], check=True)
    return to / f"mpm_fenicsx-{VERSION}"


@pytest.fixture(scope="module")
def wheel(unpacked, tmp_path_factory):
    """The wheel that is built from the source distribution."""
    return build(unpacked, "wheel", tmp_path_factory.mktemp("wheel"))


def test_a_source_distribution_has_what_git_has_and_nothing_that_work_left(unpacked):
    files = {
        path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()
    }
    made = {
        name
        for name in files
        if name in ("PKG-INFO", "setup.cfg") or name.startswith("mpm_fenicsx.egg-info/")
    }
    had = tracked()
    assert not had - files, f"MANIFEST.in leaves out {sorted(had - files)}"
    assert not files - made - had, f"MANIFEST.in takes {sorted(files - made - had)}"
    for script in (".ci/run", "scripts/setup.sh"):
        assert (unpacked / script).stat().st_mode & 0o100, f"{script} cannot be run"


def test_a_wheel_is_the_package_with_its_types(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    package = {name for name in names if name.startswith("mpm_fenicsx/")}
    assert package == {name for name in tracked() if name.startswith("mpm_fenicsx/")}
    assert "mpm_fenicsx/py.typed" in package
    about = f"mpm_fenicsx-{VERSION}.dist-info/"
    assert all(name.startswith(about) for name in names - package)
    assert about + "licenses/LICENSE" in names


def test_a_wheel_says_the_version_and_runs_from_elsewhere(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r})\n"
        "import importlib.metadata, mpm_fenicsx, mpm_fenicsx.scenes.column\n"
        "print(mpm_fenicsx.__file__, mpm_fenicsx.__version__)\n"
        "print(importlib.metadata.version('mpm_fenicsx'))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    where, *versions = done.stdout.split()
    assert Path(where).parent == tmp_path / "site" / "mpm_fenicsx"
    assert versions == [VERSION, VERSION]
    with zipfile.ZipFile(wheel) as archive:
        (about,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        read = Parser().parsestr(archive.read(about).decode())
    assert set(read.get_all("Provides-Extra")) == set(EXTRAS)


def test_the_version_is_one():
    assert "version" in PROJECT["project"]["dynamic"]
    citation, recipe = ((ROOT / f).read_text() for f in ("CITATION.cff", "conda/recipe.yaml"))
    assert re.findall(r"^version: (.*)$", citation, re.MULTILINE) == [VERSION]
    assert re.findall(r"^  version: (\d.*)$", recipe, re.MULTILINE) == [VERSION]


def canonical(requirement):
    """Name and bounds of a requirement, whether of pip or of conda: ``ruff>=0.17`` is ``ruff
    >=0.17``."""
    name, bounds = re.fullmatch(r"([\w.-]+)\s*(.*)", requirement).groups()
    return name.lower(), bounds


def listed(file, key):
    """The plain items of a list in a YAML file, that is of lines ``- item`` below ``key:``."""
    lines = (ROOT / file).read_text().splitlines()
    (start,) = (i for i, line in enumerate(lines) if line.strip() == f"{key}:")
    depth = len(lines[start]) - len(lines[start].lstrip())
    items = []
    for line in lines[start + 1 :]:
        here = len(line) - len(line.lstrip())
        if line and here <= depth:
            break
        if line.strip().startswith("- ") and not line.endswith(":") and here == depth + 2:
            items.append(canonical(line.strip()[2:]))
    assert items
    return items


def required(*extras):
    """Requirements of the package and of some of its extras; not the package itself."""
    given = PROJECT["project"]["dependencies"] + [r for e in extras for r in EXTRAS[e]]
    return {canonical(r) for r in given if not r.startswith("mpm_fenicsx")}


DOLFINX_OF_CONDA = {
    ("fenics-dolfinx", ">=0.5,<0.12"),
    ("petsc", "* real_*"),
    ("petsc4py", ""),
    ("mpi4py", ""),
}


def test_condas_package_takes_what_pips_takes():
    python = "python", PROJECT["project"]["requires-python"]
    run = listed("conda/recipe.yaml", "run")
    assert sorted(run) == sorted(DOLFINX_OF_CONDA | required() | {python, ("__unix", "")})
    host = set(listed("conda/recipe.yaml", "host"))
    assert {python, *map(canonical, PROJECT["build-system"]["requires"])} < host


def test_condas_environment_has_what_runs_tests_and_demos_take():
    has = listed("environment.yml", "dependencies")
    assert DOLFINX_OF_CONDA | required("plot", "demo", "test") <= set(has)
    assert ("python", PROJECT["project"]["requires-python"]) in has
    assert len(dict(has)) == len(has)


def test_dolfinx_of_the_wheel_is_the_newest_that_conda_may_take():
    (pinned,) = EXTRAS["wheel"]
    newest = dict(DOLFINX_OF_CONDA)["fenics-dolfinx"].partition(",")[2]
    assert canonical(pinned)[1].endswith(newest)


def test_the_version_of_ruff_is_one():
    (pin,) = (r for r in EXTRAS["test"] if r.startswith("ruff"))
    for file in ("Makefile", ".ci/run", ".pre-commit-config.yaml"):
        found = re.findall(r"""(?<=['"])ruff[<>=~][^'"]*""", (ROOT / file).read_text())
        assert found and set(found) == {pin}, file


def test_the_workflow_of_github_does_what_ci_does():
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert re.search(r"^      - run: bash \.ci/run$", workflow, re.MULTILINE)
    assert re.search(r"^    container: python:3\.\d+-bookworm$", workflow, re.MULTILINE)
    assert "\t" not in workflow
    limit = int(re.search(r"timeout-minutes: (\d+)", workflow)[1])
    steps = re.findall(r"^step (\d+)m|timeout (\d+)m", (ROOT / ".ci/run").read_text(), re.MULTILINE)
    assert limit > sum(int(a or b) for a, b in steps) + 10  # checkout, image


def imported(folder):
    """First names of the modules that a folder's files import, other than Python's own."""
    names = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.split(".")[0])
    return names - set(sys.stdlib_module_names) - WITH_DOLFINX - {"mpm_fenicsx"}


def test_the_package_imports_what_it_requires():
    """What extras bring is imported within functions; here it may be missing."""
    names = {name for name, _ in required()}
    assert names <= imported("mpm_fenicsx") <= names | {canonical(r)[0] for r in EXTRAS["plot"]}


def test_demos_import_what_their_extra_brings():
    own = {path.stem for path in (ROOT / "demos").rglob("*.py")}
    assert imported("demos") - own <= {name for name, _ in required("demo")}
