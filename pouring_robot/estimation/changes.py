"""What conditions change in the rows of a campaign, row by row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from pouring_robot.batch.structure import Structure
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.local_parameters import COMPONENTS

SCALE = "metrology.scale"


@dataclass(frozen=True, eq=False)
class RowChanges:
    """Changes in each of n rows, in m and rad."""

    drives: FloatArray  # added to the commanded drives, (n, D)
    placements: FloatArray  # displacement of every site, (n, sites * 6)
    base: FloatArray  # displacement of the base in its own axes, (n, 6)
    scale: FloatArray  # relative error of the measuring device's scale, (n,)

    @classmethod
    def of(cls, local: Mapping[str, FloatArray], structure: Structure, rows: int) -> RowChanges:
        """Return the changes of local parameters by name, (n,) each, in m and rad; what is not named is unchanged."""
        drives = structure.mechanism.loops.drives
        shapes = ((rows, len(drives)), (rows, 6 * structure.site_count), (rows, 6), (rows,))
        total = cls(*(np.zeros(shape) for shape in shapes))
        for name, change in local.items():
            kind, _, rest = name.rpartition(".")  # a joint may have dots in its name, or be called 'drive'
            if name == SCALE:
                total.scale[:] += change
            elif kind == "base":
                total.base[:, COMPONENTS.index(rest)] += change
            elif name.startswith("drive.") and (drive := name.removeprefix("drive.")) in drives:
                total.drives[:, drives.index(drive)] += change
            else:
                total.placements[:, 6 * structure.site(kind) + COMPONENTS.index(rest)] += change
        return total

    def __add__(self, other: RowChanges) -> RowChanges:
        """Return the sum of both changes; to first order in the rotations at one joint."""
        return RowChanges(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __getitem__(self, rows: Indices | BoolArray) -> RowChanges:
        return RowChanges(*(getattr(self, field.name)[rows] for field in fields(self)))

    def among(self, rows: Indices, count: int) -> RowChanges:
        """Return these changes as those of some of ``count`` rows, by index; the others are unchanged."""
        whole = {field.name: np.zeros((count, *getattr(self, field.name).shape[1:])) for field in fields(self)}
        for name, values in whole.items():
            values[rows] = getattr(self, name)
        return RowChanges(**whole)
