"""The house: folders import from floors below, and one module knows DOLFINx's versions."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
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
ARROWS = 61
"""So many imports between folders are a picture that can still be read."""
PARALLEL = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py"}
WITHOUT_DOLFINX = ("analytical", "common", "materials")
BEFORE_DOLFINX = {"common.requirements", "common.ranks", "common.exchange"}
"""They see that DOLFINx is there, and speak MPI."""
INNER = (
    *("motion", "region", "scene", "contributions", "supports", "properties", "update"),
    *("stencils", "cells", "composites", "deposit", "stress", "correction", "holding", "ties"),
    *("equilibrium", "yielding", "gauss", "gaps", "runs"),
)
"""Attributes of a run that hold its inner objects: what is asked of these is none of a test's
business, but for ``tests/inside.py``, where each function says why."""
LOOKS_INSIDE = 60
ARRAY = set(dir(np.ndarray))


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


# -- tests speak through the public interface ------------------------------------------------------


def inner(node, imported):
    """Whether an expression is an inner object of something that is no module: ``run.motion``,
    ``runs[0].stencils[0]``."""
    node = node.value if isinstance(node, ast.Subscript) else node
    if not isinstance(node, ast.Attribute) or node.attr not in INNER:
        return False
    return not (isinstance(node.value, ast.Name) and node.value.id in imported)


def chains(source):
    """Lines and attributes of inner objects that a test's source asks for, those by another name
    too.  ``body.stress.shape`` is none: attributes of arrays are anybody's; so is what ``bind`` of
    a term asks of its scene, which docs/how_to/own_boundary.md tells users."""
    tree, names, found = ast.parse(source), {"self"}, set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    terms = {id(n) for f in functions if f.name == "bind" for n in ast.walk(f)}
    every = [n for n in ast.walk(tree) if isinstance(n, ast.Attribute) and id(n) not in terms]
    asked = [n for n in every if n.attr not in ARRAY]
    found |= {(n.lineno, n.col_offset, n.attr) for n in asked if inner(n.value, names)}
    for function in functions:
        pairs = []
        for node in (n for n in ast.walk(function) if isinstance(n, ast.Assign)):
            for target in node.targets:
                several = all(isinstance(n, ast.Tuple) for n in (target, node.value))
                several = several and len(target.elts) == len(node.value.elts)
                both = (target.elts, node.value.elts) if several else ([target], [node.value])
                pairs += zip(*both, strict=True)
        other = {t.id for t, value in pairs if isinstance(t, ast.Name) and inner(value, names)}
        for n in (n for n in ast.walk(function) if n in asked):
            if isinstance(n.value, ast.Name) and n.value.id in other:
                found.add((n.lineno, n.col_offset, n.attr))
    return sorted(found)


def test_tests_look_inside_in_few_places_each_with_its_reason():
    """A function of ``inside.py`` counts as one place, like a chain anywhere else."""
    folder = Path(__file__).parent
    body = ast.parse((folder / "inside.py").read_text()).body
    body += [node for kind in body if isinstance(kind, ast.ClassDef) for node in kind.body]
    functions = [node for node in body if isinstance(node, ast.FunctionDef)]
    reasons = [function for function in functions if not function.name.startswith("__")]
    silent = [function.name for function in reasons if not ast.get_docstring(function)]
    assert not silent, f"say in a line why a test may look there: {silent}"
    elsewhere = [
        f"{path.relative_to(folder)}:{line} .{attribute}"
        for path in sorted(folder.rglob("*.py"))
        if path.name != "inside.py"
        for line, _, attribute in chains(path.read_text())
    ]
    assert len(elsewhere) + len(reasons) < LOOKS_INSIDE, elsewhere


def test_the_reading_of_chains_sees_through_names():
    def seen(source):
        return [attribute for _, _, attribute in chains(source)]

    assert seen("run.equilibrium.matrix") == seen("make(1).equilibrium.matrix") == ["matrix"]
    assert seen("run.stencils[0].nodes.shape") == ["nodes"]
    assert seen("a.b.motion.region.dS") == ["dS", "region"]
    assert seen("def f(run):\n    x, m = 1, run.motion\n    return m.u") == ["u"]
    assert not seen("body.stress.shape, body.stress[0].mean(), run.motion, run.nodal('velocity')")
    assert not seen("import study\nstudy.cells.of(3)")
    assert not seen("def bind(self, scene):\n    return scene.motion.u")


def test_files_of_tests_have_names_of_their_own():
    """Pytest imports them by name: of two with one name it takes neither in one go."""
    names = [path.name for path in (PACKAGE.parent / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
