"""Where groups are in the world, and what is placed there with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from encore.adapters import instance_primvars
from encore.adapters.instance_primvars import InstancePrimvars
from encore.adapters.instancer import Matrices, product, regular_matrices
from encore.adapters.matrix_motion import MatrixKeys
from encore.adapters.shading_rate import RateArray
from encore.groups import Placement
from encore.materials import BoundMaterial

_SMALL = 64  # matrices of a child that is multiplied together with others


@dataclass(frozen=True)
class Placed:
    """Where a group is in the world: path, or path[id].

    material: replaces that of all its meshes. rates: per matrix, replace theirs where above 0. motion: (n, k,
    4, 4) keys over the shutter, where any of the n matrices moves. primvars: per matrix, by name.
    """

    matrices: Matrices
    path: str = ""
    ids: npt.NDArray[np.int64] | None = None
    material: BoundMaterial | None = None
    rates: RateArray | None = None
    motion: MatrixKeys | None = None
    primvars: InstancePrimvars = field(default_factory=dict)

    def path_of(self, index: int) -> str:
        return self.path if self.ids is None else f"{self.path}[{self.ids[index]}]"


def chosen(placed: Placed, which: npt.NDArray[np.bool_]) -> Placed:
    """Some of the places."""
    return replace(
        placed,
        matrices=placed.matrices[which],
        ids=None if placed.ids is None else placed.ids[which],
        rates=None if placed.rates is None else placed.rates[which],
        motion=None if placed.motion is None else placed.motion[which],
        primvars=instance_primvars.chosen(placed.primvars, which),
    )


def spread(
    children: Sequence[Placement], outer: Matrices
) -> Iterator[tuple[Placement, Matrices, npt.NDArray[np.bool_]]]:
    """The children with their matrices at each of the outer places in turn, and which of those are regular.

    At a single outer place, those of small children are found all at once: there may be very many.
    """
    single = len(outer) == 1
    small = [c for c in children if len(c.matrices) <= _SMALL] if single else []
    if small:
        together = product(np.concatenate([c.matrices for c in small]), outer[0])
        regular = regular_matrices(together)
    start = 0
    for child in children:
        count = len(child.matrices)
        if single and count <= _SMALL:
            yield child, together[start : start + count], regular[start : start + count]
            start += count
            continue
        if single:
            matrices = product(child.matrices, outer[0])
        else:
            matrices = (child.matrices[None] @ outer[:, None]).reshape(-1, 4, 4)
        yield child, matrices, regular_matrices(matrices)


def given_at(places: list[Placed]) -> dict[str, int]:
    """Floats of the primvars that instances give at the places, by name."""
    return instance_primvars.given_widths(p.primvars for p in places)


def materials_of(places: list[Placed]) -> tuple[BoundMaterial | None, ...]:
    """Each once."""
    return tuple(dict.fromkeys(p.material for p in places))
