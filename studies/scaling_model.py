"""A model of the time of a step on n ranks, with constants from what ``scaling`` measures, and
where it leads to on a cluster.

    T(n, N, d) = t₀ + b k [N/n t_point + C/n (t_cell + I t_iteration)]      own work
                 + t₁                                                       of several ranks alone
                 + s (B₀ + I B₁) / bandwidth + m (M₀ + I M₁) latency        edges of ranks
                 + (R₀ + I R₁) log₂(n) t_level                              sums over ranks

N points in C = N / 2^d cells; I iterations of the solver; s nodes on the edge of a rank, 2d
(C/n)^((d-1)/d) of a cube; m neighbours; b balance, the fullest rank over the mean; k crowding, what
cores of one machine take longer because they share its memory; t₀ and t₁ are there whatever the
size.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

POINTS = ("locate", "project", "predict", "load", "force", "recover", "correct", "carry", "migrate")
CELLS = ("assemble", "factor", "record", "other")
UNKNOWNS = 2**31
"""So many PETSc can number with 32 bits."""
CLUSTER = {
    "latency_s": 2e-6,
    "bytes_a_second": 12.5e9 / 64,  # 100 Gbit/s, which the 64 ranks of a machine share
    "level_s": 2e-6,  # of a sum over ranks, for each doubling of their number
    "memory_bytes": 4e9,  # a rank
}
"""What is assumed of a usual cluster."""
BALANCE = 1.05
"""What is assumed of the ranks' work there: the fullest over the mean."""
MANY, RANKS = 1e9, 1000
"""Points, in 3D, and ranks of the projection."""


@dataclass(frozen=True)
class Constants:
    """Of one dimension: ``fixed``, ``point``, ``cell``, ``iteration`` in seconds on one rank; bytes
    a node on the edge, messages a neighbour and sums, in a step and in an iteration."""

    dim: int
    iterations: float
    fixed: float
    point: float
    cell: float
    iteration: float
    bytes_step: float
    bytes_iteration: float
    messages_step: float
    messages_iteration: float
    sums_step: float
    sums_iteration: float
    several: float = 0.0
    crowding: float = 1.0


def nodes_on_the_edge(dim: int, cells: float) -> float:
    """Of a cube of cells that has neighbours all around."""
    return 2 * dim * cells ** ((dim - 1) / dim)


def seconds(
    of: Constants,
    points: float,
    ranks: int,
    network: dict[str, float],
    balance: float = 1.0,
    nodes: float | None = None,
    neighbours: float | None = None,
) -> dict[str, float]:
    """Seconds of a step, in parts; ``nodes`` on the edge of a rank, and ranks beside it, are those
    of a cube among cubes unless they are given."""
    own, cells, i = points / ranks, points / ranks / 2**of.dim, of.iterations
    work = own * of.point + cells * (of.cell + i * of.iteration)
    if ranks == 1:
        return {"own work": of.fixed + work, "edges": 0.0, "sums": 0.0}
    if nodes is None:
        nodes = nodes_on_the_edge(of.dim, cells)
    if neighbours is None:
        neighbours = min(ranks - 1, 3**of.dim - 1)
    sent = nodes * (of.bytes_step + i * of.bytes_iteration)
    messages = neighbours * (of.messages_step + i * of.messages_iteration)
    sums = of.sums_step + i * of.sums_iteration
    return {
        "own work": of.fixed + of.several + balance * of.crowding * work,
        "edges": sent / network["bytes_a_second"] + messages * network["latency_s"],
        "sums": sums * np.log2(ranks) * network["level_s"],
    }


def largest(rows: list[dict], kind: str, dim: int | None = None) -> dict:
    """Of the rows of a kind, and dimension, the one with most points."""
    found = [row for row in rows if row["kind"] == kind and dim in (None, row["dim"])]
    return max(found, key=lambda row: row["points"])


def constants(rows: list[dict], dim: int) -> Constants:
    """What the rows say: seconds of the block on one rank with Jacobi's preconditioner, what of
    them does not grow with the block from the smaller one of "weak"; bytes, messages and sums from
    two ranks; crowding, and what several ranks take whatever the size, from the steps of two."""
    strong, weak = largest(rows, "strong", dim), largest(rows, "weak", dim)
    alone, volume = strong["runs"]["1, Jacobi"], strong["runs"]["2"]["volume"]
    points, i = strong["points"], volume["iterations"]
    cells = points / 2**dim
    fixed = weak["runs"]["1, Jacobi"]["wall"] - weak["points"] * alone["wall"] / points
    fixed = max(0.0, fixed / (1.0 - weak["points"] / points))
    grows = 1.0 - fixed / alone["wall"]
    nodes = volume["boundary_nodes"]
    plain = Constants(
        dim,
        i,
        fixed,
        grows * sum(alone["pieces"][piece] for piece in POINTS) / points,
        grows * sum(alone["pieces"][piece] for piece in CELLS) / cells,
        grows * alone["pieces"]["solve"] / cells / max(alone["iterations"], 1),
        (volume["fields"] + volume["matrix"]) / nodes,
        volume["solver"] / i / nodes,
        volume["field_passes"],
        volume["solver_messages"] / i / volume["neighbours"],
        volume["other_sums"],
        volume["solver_sums"] / i,
    )
    work, more = zip(*(_beyond(plain, rows, row) for row in (strong, weak)), strict=True)
    crowding = max(1.0, (more[0] - more[1]) / (work[0] - work[1]))
    return replace(plain, crowding=crowding, several=max(0.0, more[1] - crowding * work[1]))


def _beyond(of: Constants, rows: list[dict], row: dict) -> tuple[float, float]:
    """Seconds of own work on two ranks as the model has it, and what of the measured step is
    neither fixed nor sent."""
    parts = on_two(of, rows, row)
    own = parts["own work"] - of.fixed
    return own, row["runs"]["2"]["wall"] - of.fixed - parts["edges"] - parts["sums"]


def on_two(of: Constants, rows: list[dict], row: dict) -> dict[str, float]:
    """The model's step of a case that two ranks have run here, on the edge that they had."""
    run = row["runs"]["2"]
    edge = run["volume"]["boundary_nodes"], run["volume"]["neighbours"]
    return seconds(of, sum(run["points"]), 2, of_network(rows), run["imbalance"], *edge)


def of_network(rows: list[dict]) -> dict[str, float]:
    """The network between the two ranks here."""
    return largest(rows, "network")["runs"]["2"]


def bytes_a_point(rows: list[dict], dim: int) -> float:
    """Between the block of "weak" and that of "strong" on one rank, where what every process has
    cancels."""
    large, small = largest(rows, "strong", dim), largest(rows, "weak", dim)
    more = large["runs"]["1"]["bytes"][0] - small["runs"]["1"]["bytes"][0]
    return more / (large["points"] - small["points"])


def projection(rows: list[dict]) -> dict:
    """The constants, seconds of steps on the cluster, and what ends first there."""
    of = {dim: constants(rows, dim) for dim in (2, 3)}
    memory = {dim: bytes_a_point(rows, dim) for dim in of}
    check = {}
    for dim, one in of.items():
        row = largest(rows, "moving", dim)
        modelled = sum(on_two(one, rows, row).values())
        check[f"moving {dim}D"] = modelled / row["runs"]["2"]["wall"]
    steps = []
    for ranks in np.unique(np.geomspace(30, 300_000, 25).round()).astype(int).tolist():
        parts = seconds(of[3], MANY, ranks, CLUSTER, BALANCE)
        steps.append({"ranks": ranks, **parts})
    at = seconds(of[3], MANY, RANKS, CLUSTER, BALANCE)
    alone = sum(seconds(of[3], MANY, 1, CLUSTER).values()) / RANKS
    return {
        "constants": [asdict(one) for one in of.values()],
        "modelled_over_measured": check,
        "assumed": {**CLUSTER, "balance": BALANCE},
        "bytes_a_point": {str(dim): bytes_ for dim, bytes_ in memory.items()},
        "points": MANY,
        "ranks": RANKS,
        "parts": at,
        "efficiency": alone / sum(at.values()),
        "bytes_a_rank": memory[3] * MANY / RANKS,
        "least_ranks": MANY * memory[3] / CLUSTER["memory_bytes"],
        "most_points": {str(dim): UNKNOWNS / dim * 2**dim for dim in of},
        "steps": steps,
    }
