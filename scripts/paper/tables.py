"""The paper's tables, as far as a reader has entered them: ``paper_tables.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pydantic

from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate
from pouring_robot.robot.dh.chain import TRANSFORMS

TABLES_FILE = Path(__file__).with_name("paper_tables.yaml")


class PaperTables(StrictModel):
    """The tables; None is one that nobody has.

    Attributes:
        table_1: meaning of each transform's errors on the machine.
        table_3: order of position (mm) and attitude (rad) of chain 1's errors, by short name.
        poses_mm: positions of o in Tables 4 and 5.
        eigenvalues: Table 6, the larger first.
    """

    table_1: dict[str, str] | None = None
    table_3: dict[str, tuple[float, float]] | None = None
    poses_mm: Annotated[list[tuple[float, float, float]], pydantic.Field(min_length=10, max_length=10)] | None = None
    eigenvalues: tuple[float, float] | None = None

    @pydantic.model_validator(mode="after")
    def _known(self) -> PaperTables:
        if self.table_1 is not None and set(self.table_1) != set(TRANSFORMS):
            raise ValueError(f"table_1 needs a row for each of {', '.join(TRANSFORMS)}")
        return self


def load_tables(path: Path = TABLES_FILE) -> PaperTables:
    """Read the tables.

    Raises:
        DescriptionError: the file is missing or wrong; names file, line and key.
    """
    return validate(PaperTables, read_yaml(path), path)
