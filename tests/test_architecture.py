"""The floors of the package: a module imports from below, and only two know of DOLFINx's versions."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import mpm_fenicsx

PACKAGE = Path(mpm_fenicsx.__file__).parent
FLOORS = {
    "checks": 0, "tensors": 0, "kernels": 0, "lattice": 0, "points": 0, "time_stepping": 0, "exact": 0, "newton": 0,
    "logarithmic": 0, "kinematics": 0, "materials.hencky": 0,
    "materials": 0, "materials.elastic": 0, "materials.von_mises": 0,
    "complementarity": 0, "random_numbers": 0,
    "files": 0, "caches": 0, "needs": 1,
    "failure": 0, "checkpoint": 1, "compiling": 1, "fenicsx": 1, "partition": 1, "grid": 1, "region": 1,
    "forms": 1, "output": 1,
    "shapes": 2, "composite": 2, "projection": 2, "motion": 2, "scene": 2, "terms": 2, "mapping": 2, "ghost_penalty": 2,
    "loads": 0, "staircase": 0, "law_checks": 0, "identity": 2, "scene_checks": 2, "reach": 2, "inside": 2,
    "b_bar_checks": 0, "supports": 2, "meeting_supports": 2, "prescribed": 0, "options": 2, "interfaces": 2,
    "acceleration_correction": 2, "ties": 2,
    "reactions": 2, "gauss": 2, "velocities": 2, "yielding": 2, "yielding_at_points": 2, "equilibrium": 2,
    "part": 2, "solver": 2, "update": 2, "entry": 2,
    "properties": 2, "kept": 2, "internal_force": 2, "patches": 2, "faces": 2, "finite_strain": 2,
    "finite_strain_elements": 2,
    "cell_materials": 2,
    "touching": 2, "gaps": 2, "impact": 2,
    "statics": 3, "contact": 3, "run": 3, "simulation": 3, "finite_elements": 3,
    "recorders": 4,
    "": 5,
}
PARALLEL = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py"}


def name(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports(module):
    """Modules of the package, and first names of others, that a module imports anywhere in its text."""
    own, others = set(), set()
    folder = module.split(".") if FILES[module].name == "__init__.py" else module.split(".")[:-1]
    folder = [part for part in folder if part]
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").split(".")[0] == PACKAGE.name):
            if node.level:
                base = folder[: len(folder) - node.level + 1] + (node.module.split(".") if node.module else [])
            else:
                base = node.module.split(".")[1:]
            for alias in node.names:
                below = ".".join([*base, alias.name])
                own.add(below if below in FILES else ".".join(base))
        elif isinstance(node, ast.ImportFrom):
            others.add(node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            for alias in node.names:
                first, *rest = alias.name.split(".")
                if first == PACKAGE.name:
                    own.add(".".join(rest))
                else:
                    others.add(first)
    return own, others


def test_every_module_has_a_floor():
    homeless = sorted(set(FILES) - set(FLOORS))
    assert not homeless, f"give {homeless} a floor in FLOORS of {__file__}"


@pytest.mark.parametrize("module", sorted(set(FILES) & set(FLOORS)))
def test_a_module_imports_from_its_own_floor_and_those_below(module):
    above = sorted(m for m in imports(module)[0] if FLOORS.get(m, 9) > FLOORS[module])
    assert not above, f"{module} on floor {FLOORS[module]} imports {above}"


def test_imports_make_no_circle():
    graph = {module: imports(module)[0] - {module} for module in FILES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"modules import one another: {' <- '.join(error.args[1])}")


@pytest.mark.parametrize("module", sorted(m for m in FILES if FLOORS.get(m) == 0))
def test_the_ground_floor_knows_neither_dolfinx_nor_mpi(module):
    assert not imports(module)[1] & PARALLEL


@pytest.mark.parametrize("module", sorted(set(FILES) - {"fenicsx", "equilibrium"}))
def test_versions_of_dolfinx_show_in_two_modules_only(module):
    text = FILES[module].read_text()
    switches = r"_cpp_object|dolfinx\.__version__|fenicsx\.(version|_recent)|hasattr\((fem|dolfinx|dmesh|mesh)\b"
    assert not re.findall(switches, text)


def test_names_promised_are_there():
    assert len(set(mpm_fenicsx.__all__)) == len(mpm_fenicsx.__all__)
    assert all(hasattr(mpm_fenicsx, name) for name in mpm_fenicsx.__all__)
    public = {n for n in vars(mpm_fenicsx) if not n.startswith("_") and n not in FILES and n != "annotations"}
    assert public == set(mpm_fenicsx.__all__)


def test_the_reading_of_imports_sees_all_kinds():
    """The test's own eyes: relative, nested and sub-package imports are seen."""
    assert "fenicsx" in imports("grid")[0] and "meshio" in imports("grid")[1]
    assert {"checks"} <= imports("materials.elastic")[0] and "materials.elastic" in imports("materials")[0]
    assert {"dolfinx", "petsc4py", "mpi4py"} <= imports("equilibrium")[1]
