"""The house: folders import from floors below, and one module knows DOLFINx's versions."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import mpm_fenicsx

PACKAGE = Path(mpm_fenicsx.__file__).parent
FLOORS = {
    "common": 1,
    "analytical": 1,
    "materials": 2,
    "grid": 2,
    "dynamics": 3,
    "points": 3,
    "output": 3,
    "mapping": 4,
    "response": 5,
    "terms": 5,
    "solver": 6,
    "runs": 7,
    "contact": 8,
    "": 9,
    "scenes": 10,
}
ARROWS = 60
"""So many imports between folders are a picture that can still be read."""
PARALLEL = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py"}
WITHOUT_DOLFINX = ("analytical", "common", "materials")
BEFORE_DOLFINX = {"common.requirements", "common.ranks"}
"""They see that DOLFINx is there, and speak MPI."""


def name(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
FOLDERS = {
    module: path.relative_to(PACKAGE).parent.as_posix().strip(".") for module, path in FILES.items()
}


def imports(module):
    """Modules of the package, and first names of others, that a module imports anywhere."""
    own, others = set(), set()
    folder = [part for part in FOLDERS[module].split("/") if part]
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.ImportFrom):
            parts = node.module.split(".") if node.module else []
            if not node.level and parts[0] != PACKAGE.name:
                others.add(parts[0])
                continue
            base = folder[: len(folder) - node.level + 1] + parts if node.level else parts[1:]
            for alias in node.names:
                below = ".".join([*base, alias.name])
                own.add(below if below in FILES else ".".join(base))
        elif isinstance(node, ast.Import):
            for alias in node.names:
                first, *rest = alias.name.split(".")
                if first == PACKAGE.name:
                    own.add(".".join(rest))
                else:
                    others.add(first)
    return own, others


def arrows():
    """Pairs of folders, the first of which imports from the second."""
    pairs = {(FOLDERS[module], FOLDERS[other]) for module in FILES for other in imports(module)[0]}
    return {(a, b) for a, b in pairs if a != b}


def test_every_folder_has_a_floor():
    assert set(FOLDERS.values()) == set(FLOORS), (
        f"give every folder a floor in FLOORS of {__file__}"
    )


@pytest.mark.parametrize("module", sorted(FILES))
def test_a_module_imports_from_its_own_folder_and_floors_below(module):
    folder = FOLDERS[module]
    above = {
        m
        for m in imports(module)[0]
        if FOLDERS[m] != folder and FLOORS[FOLDERS[m]] >= FLOORS[folder]
    }
    assert not above, f"{module} on floor {FLOORS[folder]} imports {sorted(above)}"


def test_imports_make_no_circle():
    graph = {module: imports(module)[0] - {module} for module in FILES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"modules import one another: {' <- '.join(error.args[1])}")


def test_few_arrows_join_the_folders():
    """Of the package, and from scripts beside it into the package's folders and to one another."""
    inside = {pair for pair in arrows() if pair[0]}
    root, beside = PACKAGE.parent, ("studies", "demos", "benchmarks")
    of = {path.stem: name for name in beside for path in (root / name).glob("*.py")}
    outside = set()
    for name in beside:
        for path in (root / name).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom):
                    modules = [node.module]
                elif isinstance(node, ast.Import):
                    modules = [alias.name for alias in node.names]
                else:
                    continue
                for module in modules:
                    first, *rest = module.split(".")
                    if first == PACKAGE.name and rest:
                        outside.add((name, rest[0]))
                    elif of.get(first, name) != name:
                        outside.add((name, of[first]))
    assert len(inside | outside) <= ARROWS, f"{len(inside)} inside, {len(outside)} from beside"


@pytest.mark.parametrize("module", sorted(m for m in FILES if FOLDERS[m] in WITHOUT_DOLFINX))
def test_the_ground_floor_knows_neither_dolfinx_nor_mpi(module):
    if module not in BEFORE_DOLFINX:
        assert not imports(module)[1] & PARALLEL


def test_exact_answers_import_nothing_of_the_package():
    assert not {b for a, b in arrows() if a == "analytical"}


@pytest.mark.parametrize(
    "module", sorted(set(FILES) - {"grid.dolfinx_versions", "solver.equilibrium"})
)
def test_versions_of_dolfinx_show_in_two_modules_only(module):
    switches = (
        r"_cpp_object|dolfinx\.__version__|dolfinx_versions\.(version|_recent)"
        r"|hasattr\((fem|dolfinx|dmesh|mesh)\b"
    )
    assert not re.findall(switches, FILES[module].read_text())


def test_names_promised_are_there():
    assert len(set(mpm_fenicsx.__all__)) == len(mpm_fenicsx.__all__)
    assert all(hasattr(mpm_fenicsx, name) for name in mpm_fenicsx.__all__)
    public = {
        n
        for n in vars(mpm_fenicsx)
        if not n.startswith("_") and n not in FLOORS and n != "annotations"
    }
    assert public == set(mpm_fenicsx.__all__)


def test_the_reading_of_imports_sees_all_kinds():
    """The test's own eyes: relative, nested and sub-package imports are seen."""
    own, others = imports("grid.grid")
    assert "grid.dolfinx_versions" in own and "common.checks" in own and "meshio" in others
    assert {"common.checks"} <= imports("materials.elastic")[0]
    assert "materials.elastic" in imports("materials")[0] and "materials" in imports("")[0]
    assert {"dolfinx", "petsc4py", "mpi4py"} <= imports("solver.equilibrium")[1]
