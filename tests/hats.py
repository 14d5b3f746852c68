"""Hat functions on grid lines that owe nothing to the package."""

import numpy as np

LINES = {
    2: ([-3.0, -2.2, -1.6, -0.6, 0.1], [10.0, 10.5, 11.4, 12.0]),
    3: ([-3.0, -2.2, -1.6, -0.6], [10.0, 10.5, 11.4, 12.0], [0.5, 0.8, 1.4, 1.8]),
}


class Hats:
    """Products of hat functions on grid lines; dof i of the grid's space is the node at
    ``place[i]``."""

    def __init__(self, grid):
        self.lines = [np.array(line) for line in LINES[grid.dim]]
        node = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
        self.place = np.array(
            [np.abs(line - node[:, d, None]).argmin(axis=1) for d, line in enumerate(self.lines)]
        ).T
        self.node = node

    def cell(self, d, x):
        """Index of the interval of direction d that holds x: on a line the one above, at the end
        the last."""
        return np.clip(
            np.searchsorted(self.lines[d], x, side="right") - 1, 0, len(self.lines[d]) - 2
        )

    def box(self, x, half):
        """Support domains [a, b]: no wider than the point's cell, no further than the cells beside
        it."""
        a, b = np.empty_like(x), np.empty_like(x)
        for d, line in enumerate(self.lines):
            c = self.cell(d, x[:, d])
            l = np.minimum(half[:, d], (line[c + 1] - line[c]) / 2)
            a[:, d] = np.maximum(x[:, d] - l, line[np.maximum(c - 1, 0)])
            b[:, d] = np.minimum(x[:, d] + l, line[np.minimum(c + 2, len(line) - 1)])
        return a, b

    def hat(self, d, y):
        """Values and slopes (..., k) of the k hats of direction d."""
        line, c = self.lines[d], self.cell(d, y)
        value = np.stack([np.interp(y, line, row) for row in np.eye(len(line))], -1)
        slope = np.zeros_like(value)
        for step, sign in ((0, -1.0), (1, 1.0)):
            np.put_along_axis(
                slope, c[..., None] + step, (sign / (line[c + 1] - line[c]))[..., None], -1
            )
        return value, slope

    def sample(self, d, a, b):
        """Weights (n, q), values and slopes (n, q, k) that average cubics over [a, b], piece by
        piece of the cells."""
        edge = np.clip(self.lines[d], a[:, None], b[:, None])
        ξ, w = np.polynomial.legendre.leggauss(3)
        middle, reach = (edge[:, 1:] + edge[:, :-1]) / 2, np.diff(edge, axis=1) / 2
        y = (middle[..., None] + reach[..., None] * ξ).reshape(len(a), -1)
        weight = (reach[..., None] * w).reshape(len(a), -1)
        if (a == b).all():
            y, weight = a[:, None], np.ones((len(a), 1))
        return weight / weight.sum(axis=1, keepdims=True), *self.hat(d, y)

    def samples(self, x, half=None):
        """``sample`` for every direction: at the points, or over their support domains."""
        a, b = (x, x) if half is None else self.box(x, half)
        return [self.sample(d, a[:, d], b[:, d]) for d in range(len(self.lines))]

    def mean(self, x, half=None, along=None):
        """Means (n, nodes) of the shape functions, or of their derivative along a direction."""
        out = 1.0
        for d, (w, value, slope) in enumerate(self.samples(x, half)):
            out = (
                out
                * np.einsum("nq,nqk->nk", w, slope if d == along else value)[:, self.place[:, d]]
            )
        return out

    def pairs(self, x, half, weight, along_i=None, along_j=None):
        """Σ_p weight_p ⟨N_i N_j⟩ (nodes, nodes), with derivatives if asked for: the mean of the
        product."""
        out = 1.0
        for d, (w, value, slope) in enumerate(self.samples(x, half)):
            left, right = slope if d == along_i else value, slope if d == along_j else value
            both = np.einsum("nq,nqk,nql->nkl", w, left, right)
            out = out * both[:, self.place[:, d]][:, :, self.place[:, d]]
        return np.einsum("n,nij->ij", weight, out)
