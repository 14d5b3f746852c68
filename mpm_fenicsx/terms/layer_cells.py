"""The cells of an absorbing layer: speeds that they absorb, stretches that follow from them."""

from __future__ import annotations

import numpy as np
from scipy.special import ellipj, ellipkm1

from ..common.checks import between, positive, whole

LARGEST_ANGLE = np.radians(80)
"""From the normal; waves beyond it run along the boundary."""
GROWTH = 3.0
"""Of the elastic cells' lengths, from one to the next."""


def zolotarev(lowest: float, highest: float, count: int) -> np.ndarray:
    """Speeds c_k (count,), falling, that make the largest modulus of ∏ (c − c_k)/(c + c_k) over
    [``lowest``, ``highest``] least.

    c_k = c_max dn((2k − 1)K/(2n), 1 − (c_min/c_max)²) (Zolotarev 1877; Wachspress 1962).  Raises
    ``ValueError`` naming what is not positive or not in order.
    """
    lowest, highest = positive("lowest", lowest), positive("highest", highest)
    count = whole("count", count)
    if lowest >= highest:
        raise ValueError(f"lowest must be below highest = {highest}, got {lowest}")
    m1 = (lowest / highest) ** 2
    K = ellipkm1(m1)
    return highest * ellipj((2 * np.arange(1, count + 1) - 1) * K / (2 * count), 1 - m1)[2]


def default_cells(
    material,
    size: float,
    count: int = 3,
    elastic: int = 4,
    angle: float = LARGEST_ANGLE,
) -> tuple[tuple[float, float], ...]:
    """Stretches (κ, β) of a layer's cells of ``size`` h (m) across, from inside out; β in 1/s.

    ``count`` cells with κ = 0 and β = 2c_k/h, of length 2c_k/p at every frequency, which absorb:
    their speeds c_k are Zolotarev's points for what runs along a normal with the apparent speeds
    0.92 c_s (surface waves) to c_p/cos ``angle`` (rad, below π/2).  Then ``elastic`` cells of
    lengths h, 3h, 9h, 27h …, which bear what does not travel, static loads above all.
    ``material`` has ``p_speed`` and ``s_speed`` (m/s), or is several, of layered ground.

    Raises ``ValueError`` naming what is out of range.
    """
    size, count = positive("size", size), whole("count", count)
    elastic, angle = whole("elastic", elastic, least=0), between("angle", angle, 0.0, np.pi / 2)
    materials = material if isinstance(material, tuple | list) else (material,)
    speeds = zolotarev(
        0.92 * min(soil.s_speed for soil in materials),
        max(soil.p_speed for soil in materials) / np.cos(angle),
        count,
    )
    absorbing = [(0.0, 2 * float(c) / size) for c in speeds]
    return (*absorbing, *((GROWTH**n, 0.0) for n in range(elastic)))
