"""The names that differ between DOLFINx 0.5 (Debian) and 0.11 (wheel), and nothing else."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

from mpi4py import MPI  # before dolfinx: the wheel's dolfinx finds its MPI through it

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from dolfinx import fem, graph, la

from . import form_compiler

version = dolfinx.__version__
_recent = hasattr(fem, "functionspace")
_SHAPES = {2: "quadrilateral", 3: "hexahedron"}
# sums may be taken in another order, which vector units need; NaN stays NaN; -O3 compiles twice as
# long for nothing
_FLAGS = (
    "-O2 -ftree-vectorize -fvect-cost-model=dynamic -march=native -fno-math-errno "
    "-fno-trapping-math -fno-signed-zeros -fassociative-math -freciprocal-math"
)
_JIT = {"cffi_extra_compile_args": os.environ.get("MPM_FENICSX_CFLAGS", _FLAGS).split()}
_OPTIONS = {"jit_options" if _recent else "jit_params": _JIT}
FORMS_FOLLOW = _recent
"""Whether forms take up other cells of a ``cell_measure``."""
MATERIAL = 1
"""The mark of the cells of a ``cell_measure``."""
_ADD = la.InsertMode.add if _recent else la.ScatterMode.add
# UFL of 2022 doubts that the text of a rule's points tells it from other rules: it does
logging.getLogger("UFL").addFilter(lambda record: "type ndarray" not in record.getMessage())


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the compiler lines that DOLFINx 0.5 logs."""
    disabled = logging.root.manager.disable
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(disabled)


def space(mesh, family: str, degree: int, shape: tuple[int, ...] = ()):
    """Function space on ``mesh``; "Lagrange", or "DQ" for the discontinuous one on
    quadrilaterals."""
    if _recent:
        return fem.functionspace(mesh, (family, degree, shape) if shape else (family, degree))
    make = partial(fem.VectorFunctionSpace, dim=shape[0]) if shape else fem.FunctionSpace
    with _quiet():
        return form_compiler.build(mesh.comm, partial(make, mesh, (family, degree)))


def quadrature_space(mesh, degree: int, size: int):
    """Space of ``size`` numbers at the quadrature points of ``degree``; forms must integrate with
    that degree."""
    if _recent:
        import basix.ufl

        element = basix.ufl.quadrature_element(
            mesh.topology.cell_name(), value_shape=(size,), degree=degree
        )
        return fem.functionspace(mesh, element)
    element = ufl.VectorElement(
        "Quadrature", mesh.ufl_cell(), degree, dim=size, quad_scheme="default"
    )
    with _quiet():
        return form_compiler.build(mesh.comm, partial(fem.FunctionSpace, mesh, element))


def cell_dofs(V) -> np.ndarray:
    """Blocked dofs of each local and ghost cell (cells, dofs per cell)."""
    table = V.dofmap.list if _recent else V.dofmap.list.array
    return np.asarray(table, dtype=np.int32).reshape(-1, V.dofmap.dof_layout.num_dofs)


def cell_vertices(mesh) -> np.ndarray:
    """Geometry nodes of each local and ghost cell (cells, 2^dim)."""
    geometry = mesh.geometry
    table = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap.array
    return np.asarray(table, dtype=np.int32).reshape(-1, 2**mesh.topology.dim)


def cell_measure(mesh, cells: np.ndarray):
    """Measure of the cells, and the list [(MATERIAL, cells)] that says which; 0.5 takes all,
    whatever the list."""
    domains = [(MATERIAL, cells)]
    if not _recent:
        return ufl.Measure("dx", domain=mesh), domains
    return ufl.Measure("dx", domain=mesh, subdomain_data=domains, subdomain_id=MATERIAL), domains


def facet_measure(mesh, facets: np.ndarray):
    """Measure of interior facets given as rows (facets, 4): a cell and the facet's number in it, on
    both sides; and the list that says which.  0.5 takes all, whatever the list."""
    domains = [(MATERIAL, facets)]
    if not _recent:
        return ufl.Measure("dS", domain=mesh), domains
    return ufl.Measure("dS", domain=mesh, subdomain_data=domains, subdomain_id=MATERIAL), domains


def interior_facets(mesh) -> np.ndarray:
    """All facets of this rank between two cells, rows for ``facet_measure``; 0.5 needs none."""
    if not _recent:
        return np.zeros((0, 4), dtype=np.int32)
    topology, dim = mesh.topology, mesh.topology.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    between = np.flatnonzero(np.diff(topology.connectivity(dim - 1, dim).offsets) == 2).astype(
        np.int32
    )
    return fem.compute_integration_domains(
        fem.IntegralType.interior_facet, topology, between
    ).reshape(-1, 4)


def global_numbers(index_map) -> np.ndarray:
    """Global numbers of what is local and ghost in an index map (n,)."""
    here = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    return np.asarray(index_map.local_to_global(here) if len(here) else here, dtype=np.int64)


def input_numbers(mesh) -> tuple[np.ndarray, np.ndarray]:
    """Numbers that local and ghost cells, and geometry nodes, had in the input of the mesh."""
    cells, nodes = mesh.topology.original_cell_index, mesh.geometry.input_global_indices
    return np.asarray(cells, dtype=np.int64), np.asarray(nodes, dtype=np.int64)


def create_mesh(comm: MPI.Comm, x: np.ndarray, cells: np.ndarray, owners: Callable):
    """Mesh of quadrilaterals or hexahedra, distributed as told.

    ``x`` (points, dim) and ``cells`` (cells, 2^dim), vertices in tensor order, are slices, one a
    rank, and may be empty; ``owners(ranks)`` returns offsets and, for every cell of this rank's
    slice, its owner and then its ghosts' ranks.
    """
    dim = x.shape[1]

    def partitioner(_comm, ranks, *_):
        offsets, destinations = owners(ranks)
        offsets, destinations = offsets.astype(np.int32), destinations.astype(np.int32)
        if _recent:
            return graph.adjacencylist(destinations, offsets)._cpp_object
        return graph.create_adjacencylist(destinations, offsets)

    if _recent:
        import basix.ufl

        element = basix.ufl.element("Lagrange", _SHAPES[dim], 1, shape=(dim,))
        return dolfinx.mesh.create_mesh(comm, cells, element, x, partitioner)
    # FFCx of 2022 makes places equispaced itself where it compiles, and what is made of the domain
    # afterwards would be of another one
    cell = ufl.Cell(_SHAPES[dim], dim)
    domain = ufl.Mesh(ufl.VectorElement("Lagrange", cell, 1, variant="equispaced"))
    return dolfinx.mesh.create_mesh(
        comm, cells, x, domain, dolfinx.mesh.GhostMode.shared_facet, partitioner
    )


def compile_form(form):
    """A compiled form, a list of parts to be added up; None for the empty sum of terms.

    One-point rules, and such as take the midpoint in one direction, go into kernels of their own:
    beside them FFCx (0.5 to 0.11) gives the other rules of a kernel the coefficients of that point
    (what is the same at all points of a rule is kept once for all rules).
    """
    if form is None or (isinstance(form, (int, float)) and form == 0) or form.empty():
        return None
    with _quiet():
        comm = form.ufl_domain().ufl_cargo().comm
        make = _Form if _recent else lambda part, options: fem.form(part, **options)
        return [form_compiler.build(comm, partial(make, part, _OPTIONS)) for part in kernels(form)]


def kernels(form) -> list:
    """The parts of a form that are compiled each by itself."""
    found: dict[str, list] = {}
    for part in form.integrals():
        found.setdefault(_kernel(part), []).append(part)
    parts = [ufl.Form(found[name]) for name in sorted(found)]
    return parts if len(parts) > 1 else [form]


def _kernel(integral) -> str:
    """The kernel, by a name, that an integral belongs to; "" for that of most."""
    rule = integral.metadata()
    if rule.get("quadrature_degree", 2) < 2:
        return "one point"
    points = rule.get("quadrature_points", ())
    along = [len(np.unique(line)) for line in np.asarray(points).T] if len(points) else []
    return f"midpoint in {along}" if 1 in along else ""


class _Form:
    """A form of DOLFINx 0.11 that is made anew when the cells or facets of its measures change: the
    code stays."""

    def __init__(self, form, options: dict):
        (self.domain,), self.form = form.subdomain_data(), form
        self.compiled = fem.compile_form(self.domain.ufl_cargo().comm, form, **options)
        self.made, self.where = None, [None]

    @property
    def now(self):
        """The form over what its measures have now."""
        data = self.form.subdomain_data()[self.domain]
        listed = [
            cells for marks in data.values() if isinstance(marks[0], list) for _, cells in marks[0]
        ]
        if len(listed) != len(self.where) or any(
            a is not b for a, b in zip(listed, self.where, strict=True)
        ):
            from dolfinx.fem import forms

            ids, ufcx = {}, self.compiled.ufcx_form
            for k, kind in enumerate(fem.IntegralType):
                ids[kind] = [
                    ufcx.form_integral_ids[j]
                    for j in range(ufcx.form_integral_offsets[k], ufcx.form_integral_offsets[k + 1])
                ]
            where = {forms._ufl_to_dolfinx_domain[name]: marks[0] for name, marks in data.items()}
            where = {
                kind: [at for at in marks if at[0] in ids[kind]]
                if isinstance(marks, list)
                else marks
                for kind, marks in where.items()
            }
            where = {
                kind: forms.get_integration_domains(kind, marks, ids[kind])
                for kind, marks in where.items()
            }
            mesh = SimpleNamespace(_cpp_object=self.domain.ufl_cargo())
            self.made = fem.create_form(
                self.compiled,
                [a.ufl_function_space() for a in self.form.arguments()],
                mesh,
                where,
                {c: c for c in self.form.coefficients()},
                {c: c for c in self.form.constants()},
            )
            self.where = listed
        return self.made


class CellKernel:
    """The compiled kernel of a form over cells.

    ``coefficients``: its fields, in the order of the kernel; ``width``: how many values they have
    in a cell.
    """

    def __init__(self, form, compiled, module, kernel, positions):
        self._kernel = kernel
        self._ffi, self._constants = module.ffi, form.constants()
        self._none = [self._ffi.NULL] * (len(self._ffi.typeof(self._kernel).args) - 4)
        fields = form.coefficients()
        self.coefficients = [fields[positions[i]] for i in range(compiled.num_coefficients)]
        self.width = sum(map(values_in_cell, (f.function_space for f in self.coefficients)))
        spaces = [argument.ufl_function_space() for argument in form.arguments()]
        self._entries = int(np.prod([values_in_cell(V) for V in spaces], dtype=np.int64))

    def constants(self) -> np.ndarray:
        """The values of its constants (n,), as they are now."""
        return np.concatenate([np.zeros(0), *(np.ravel(c.value) for c in self._constants)])

    def __call__(self, corners: np.ndarray, w: np.ndarray, constants: np.ndarray) -> np.ndarray:
        """The tensors (n, entries), row by row, of a cell with ``corners`` (vertices, 3), m, in the
        order of the mesh, where fields have values ``w`` (n, width)."""
        w = np.ascontiguousarray(w, dtype=float)
        found, given = np.zeros((len(w), self._entries)), (w, constants, corners)
        arrays = [np.ascontiguousarray(a if a.size else np.zeros(1), float) for a in given]
        at, of, *rest = (self._ffi.cast("double *", a.ctypes.data) for a in (found, *arrays))
        for row in range(len(w)):  # pointers, for there may be thousands
            tensor = at + row * self._entries
            self._kernel(tensor, of + row * self.width, *rest, *self._none)
        return found


def maps_as_it_is(V) -> bool:
    """Whether the values of a space's fields go to the reference cell as they are: those of vectors
    along edges or across facets are turned, too."""
    element = V.ufl_element()
    if _recent:
        return type(element.pullback).__name__ == "IdentityPullback"
    return element.mapping() == "identity"


def values_in_cell(V) -> int:
    """How many values a field of a space has in a cell."""
    return V.dofmap.dof_layout.num_dofs * V.dofmap.index_map_bs


def _of_kernel(compiled) -> tuple:
    """Positions of coefficients, and the kernels of all integrals over cells."""
    if _recent:
        first, end = (compiled.form_integral_offsets[k] for k in (0, 1))
        integrals = [compiled.form_integrals[k] for k in range(first, end)]
        positions = compiled.original_coefficient_positions
    else:
        integrals = [compiled.integrals(0)[k] for k in range(compiled.num_integrals(0))]
        positions = compiled.original_coefficient_position
    return positions, [one.tabulate_tensor_float64 for one in integrals]


def cell_kernel(form) -> CellKernel | None:
    """The kernel of one of the ``kernels`` of a form; None where it integrates over other things
    than cells, over several sets of them or, all of it being zero, over none."""
    of_cells = {(part.integral_type(), part.subdomain_id()) for part in form.integrals()}
    if len(of_cells) != 1 or next(iter(of_cells))[0] != "cell":
        return None
    comm = form.ufl_domain().ufl_cargo().comm

    def make() -> tuple:
        if _recent:
            found = fem.compile_form(comm, form, **_OPTIONS)
            return found.ufcx_form, found.module
        compiler = {"scalar_type": "double"}
        return dolfinx.jit.ffcx_jit(comm, form, form_compiler_params=compiler, **_OPTIONS)[:2]

    with _quiet():
        compiled, module = form_compiler.build(comm, make)
    positions, found = _of_kernel(compiled)
    return CellKernel(form, compiled, module, *found, positions) if len(found) == 1 else None


def _parts(form) -> list:
    return [part.now if _recent else part for part in form]


def gather(f: fem.Function) -> None:
    """Add what ghosts hold to their owners, then give owners' values to the ghosts."""
    if f.function_space.mesh.comm.size > 1:
        f.x.scatter_reverse(_ADD)
        f.x.scatter_forward()


def gather_to_owner(f: fem.Function) -> None:
    """Add what ghosts hold to their owners."""
    if f.function_space.mesh.comm.size > 1:
        f.x.scatter_reverse(_ADD)


def share(f: fem.Function) -> None:
    """Give owners' values to the ghosts."""
    if f.function_space.mesh.comm.size > 1:
        f.x.scatter_forward()


def create_matrix(form, kind: str | None = None):
    """PETSc matrix with the sparsity of ``form``; ``kind`` is PETSc's name of the format, "baij"
    for dense blocks."""
    return fem.petsc.create_matrix(_parts(form)[0], kind)


def assemble_matrix(A, form, bcs) -> None:
    """Add the form to A, rows and columns of ``bcs`` left empty but for a unit diagonal."""
    for number, part in enumerate(_parts(form)):
        if number:
            A.assemble(True)  # flushes: the diagonal was set, now is added to
        fem.petsc.assemble_matrix(A, part, bcs=bcs)


def assemble_vector(b: fem.Function, form) -> None:
    """Add the form to the local and ghost values of b."""
    for part in _parts(form):
        fem.assemble_vector(b.x.array, part)


def assemble_scalar(form) -> float:
    """Value of the form on this rank."""
    return sum(fem.assemble_scalar(part) for part in _parts(form))
