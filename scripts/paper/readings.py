"""Every interpretation of what the paper leaves open, scored on the claims of its sections 4 and 5.

The paper leaves open whether M N m n are full or half sizes, and which of them are along x; the sign of the tilt r;
which of its two directions a common normal has in the lower half of a leg; whether an error "reaches" a size at its
largest or in the mean; and the range of melt temperatures in Fig. 9. Verdicts and their rules are those of the two
studies, at fewer poses.
"""

from __future__ import annotations

import itertools
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from pouring_robot.exceptions import NoSolutionError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.layout import shipped_layouts_file
from scripts.paper.geometry.shape_claims import SHAPE_CLAIMS
from scripts.paper.geometry.size_claims import SIZE_CLAIMS
from scripts.paper.geometry.study import ErrorSamples, OpenStudy, run_open_study
from scripts.paper.page import PaperReport
from scripts.paper.thermal.claims import judge_all
from scripts.paper.thermal.study import ThermalStudy, run_thermal_study

M, N, m, n = 374.0, 680.0, 330.0, 365.0
_POSES, _LEFT_OUT, _BOX = 2000, 5, 40
_LIMITS = {"s1": [-2.0, 2.0], "s2": [-1.55, 1.55], "s4": [-1.55, 1.55], "s5": [-2.9, 2.9]}
NORMALS = ("one rule", "reversed below")
STATISTICS = ("largest", "mean")
COLDEST_DEGC = (600.0, 1100.0, 1400.0)


@dataclass(frozen=True)
class Sizes:
    """How the four numbers are read.

    Attributes:
        along_y: the letters that lie along y: ``Mm`` or ``Nn``.
        halves: the letters that are half sizes: ``""``, ``Mm``, ``Nn`` or ``MmNn``.
    """

    along_y: str
    halves: str

    def __str__(self) -> str:
        along_x = "Nn" if self.along_y == "Mm" else "Mm"
        return f"{along_x} x, {self.along_y} y; " + (f"{self.halves} half" if self.halves else "all full")

    def centres_mm(self) -> tuple[list[list[float]], list[list[float]]]:
        """Return upper and lower U-joint centres of chains 1 to 4."""
        own = {
            name: value / (1.0 if name in self.halves else 2.0)
            for name, value in zip("MNmn", (M, N, m, n), strict=True)
        }
        (fixed_y, moving_y), (fixed_x, moving_x) = (
            (own[pair[0]], own[pair[1]]) for pair in (self.along_y, "Nn" if self.along_y == "Mm" else "Mm")
        )
        signs = ((-1, 1), (-1, -1), (1, 1), (1, -1))
        return [[sx * fixed_x, sy * fixed_y, 0.0] for sx, sy in signs], [
            [sx * moving_x, sy * moving_y, 0.0] for sx, sy in signs
        ]


SIZES = tuple(Sizes(y, halves) for y in ("Mm", "Nn") for halves in ("", "Mm", "Nn", "MmNn"))


def models(folder: Path) -> dict[Sizes, RobotModel]:
    """Write a dimensions file with one layout a reading of the sizes, and return their models."""
    shipped = yaml.safe_load(shipped_layouts_file().read_text(encoding="utf-8"))
    layouts = {}
    for k, sizes in enumerate(SIZES):
        entry = {**shipped["layouts"]["paper"]}
        for key, centres in zip(("fixed_centres", "moving_centres"), sizes.centres_mm(), strict=True):
            entry[key] = {**entry[key], "value": centres, "note": str(sizes)}
        limits = {key: {"value": pair, "unit": "rad", "source": "assumed"} for key, pair in _LIMITS.items()}
        entry["joint_limits"] = limits | {"s3": {"value": [150, 1400], "unit": "mm", "source": "assumed"}}
        layouts[f"reading_{k}"] = entry
    path = folder / "layouts.yaml"
    path.write_text(yaml.safe_dump({"layouts": layouts}, sort_keys=False), encoding="utf-8")
    return {sizes: RobotModel(layout=f"reading_{k}", layouts_file=str(path)) for k, sizes in enumerate(SIZES)}


@dataclass(frozen=True)
class Scored:
    """One reading of everything, and the verdict of every claim.

    Attributes:
        sizes, tilt, normals, statistic, coldest_degC: the reading.
        geometry, thermal: verdicts by claim; None: the robot cannot be moved all over its workspace.
    """

    sizes: Sizes
    tilt: str
    normals: str
    statistic: str
    coldest_degC: float
    geometry: Mapping[str, str]
    thermal: Mapping[str, str] | None

    @property
    def score(self) -> tuple[int, int]:
        """Claims reproduced in sections 4 and 5."""
        return _won(self.geometry), _won(self.thermal or {})


def _won(verdicts: Mapping[str, str]) -> int:
    return sum(verdict == "reproduced" for verdict in verdicts.values())


class _Mean(ErrorSamples):
    """Errors that reach a size by their mean."""

    @property
    def peak_m(self) -> Any:
        return self.mean_m


def _geometry(study: OpenStudy, normals: str, statistic: str) -> dict[str, str]:
    errors = study.open_branch
    # The claim on both signs turns our lower normals over to the one rule; turned over before, they stay ours.
    turned = {"alpha_e1_45", "alpha_e1_56", "a_e1_45", "a_e1_56"} if normals == NORMALS[1] else set()
    signs = np.array([-1.0 if p.name in turned else 1.0 for p in errors.parameters])[:, None, None]
    kind = _Mean if statistic == "mean" else ErrorSamples
    read = kind(errors.kind, errors.parameters, signs * errors.translation_m, signs * errors.rotation_rad)
    return {claim.key: claim.verdict for claim in (judge(study, read) for judge in (*SIZE_CLAIMS, *SHAPE_CLAIMS))}


def _thermal(study: ThermalStudy, coldest_degC: float) -> dict[str, str]:
    kept = [k for k, melt in enumerate(study.melts_degC) if melt >= coldest_degC - 1e-6]
    part = replace(
        study,
        melts_degC=tuple(study.melts_degC[k] for k in kept),
        moved=study.moved[kept],
        left_out=study.left_out[kept],
    )
    return {claim.key: claim.verdict for claim in judge_all(part)}


def score_all(seed: int, progress: Progress = say_nothing) -> list[Scored]:
    """Score every reading; about ten seconds for each of the sizes and signs."""
    found = []
    choices = list(itertools.product(SIZES, (1.0, -1.0)))
    with tempfile.TemporaryDirectory() as folder:
        robots = models(Path(folder))
        for done, (sizes, sign) in enumerate(choices):
            progress("reading by reading", done, len(choices))
            opened = run_open_study(robots[sizes], _POSES, seed, chain=1, tilt_sign=sign)
            try:
                warm = run_thermal_study(robots[sizes], seed, 0, left_out=_LEFT_OUT, box_poses=_BOX, tilt_sign=sign)
            except NoSolutionError:
                warm = None
            by_heat = {cold: _thermal(warm, cold) if warm else None for cold in COLDEST_DEGC}
            for normals, statistic in itertools.product(NORMALS, STATISTICS):
                judged = _geometry(opened, normals, statistic)
                tilt = "as printed" if sign > 0.0 else "reversed"
                found += [Scored(sizes, tilt, normals, statistic, cold, judged, by_heat[cold]) for cold in COLDEST_DEGC]
        progress("reading by reading", len(choices), len(choices))
    return found


@dataclass(frozen=True, eq=False)
class ReadingsReport(PaperReport):
    """The scores as a page.

    Attributes:
        seed: of the poses.
        scored: all readings.
    """

    title = "What the paper leaves open, reading by reading"
    part = "readings"

    seed: int
    scored: list[Scored]

    @property
    def figures(self) -> Mapping[str, bytes]:
        """No pictures."""
        return {}

    def renderables(self) -> list[RenderableType]:
        """Return the table, the best, and which claims the choice of a reading decides."""
        first = self.scored[0]
        claims = (len(first.geometry), len(next(s.thermal for s in self.scored if s.thermal)))
        best = max(self.scored, key=lambda s: sum(s.score))
        words = (best.sizes, f"tilt {best.tilt}", f"common normals: {best.normals}", best.statistic)
        read = "; ".join(map(str, words)) + f"; coldest melt {best.coldest_degC:g} °C"
        return [
            Text(
                f"{len(self.scored)} readings, seed {self.seed}; number of claims reproduced, of {claims[0]} (section "
                f"4, open branch of chain 1, {_POSES} poses) and {claims[1]} (section 5)"
            ),
            "",
            self._by_sizes(),
            "",
            self._decided(),
            "",
            Text(f"most in all: {sum(best.score)} of {sum(claims)}, by {read}. No reading reproduces all."),
        ]

    def _by_sizes(self) -> Table:
        """Return one row a reading of sizes and tilt; columns for the others."""
        table = Table(
            title="Claims reproduced: section 4 by sense of common normals and statistic, section 5 by coldest melt",
            title_justify="left",
            title_style="bold",
        )
        for name in ("sizes (mm; 374 680 330 365)", "tilt"):
            table.add_column(name)
        for normals, statistic in itertools.product(NORMALS, STATISTICS):
            table.add_column(f"{normals}, {statistic}", justify="right")
        for cold in COLDEST_DEGC:
            table.add_column(f"{cold:g} °C", justify="right")
        table.add_column("best sum", justify="right")
        for key in dict.fromkeys((s.sizes, s.tilt) for s in self.scored):
            own = [s for s in self.scored if (s.sizes, s.tilt) == key]
            geometry = {(s.normals, s.statistic): s.score[0] for s in own}
            thermal = {s.coldest_degC: s.score[1] if s.thermal else None for s in own}
            cells = [str(geometry[pair]) for pair in itertools.product(NORMALS, STATISTICS)]
            cells += ["out of reach" if thermal[cold] is None else str(thermal[cold]) for cold in COLDEST_DEGC]
            table.add_row(str(key[0]), key[1], *cells, str(max(sum(s.score) for s in own)))
        return table

    def _decided(self) -> Table:
        """Return the claims that some readings reproduce and others do not, and with which sizes."""
        table = Table(
            title="Claims on which readings disagree, and the readings that reproduce them",
            title_justify="left",
            title_style="bold",
        )
        table.add_column("claim")
        table.add_column("share of readings", justify="right")
        table.add_column("by sizes (share of that size's readings)")
        keys = list(dict.fromkeys(key for s in self.scored for key in (*s.geometry, *(s.thermal or {}))))
        for key in keys:
            judged = [(s, {**s.geometry, **(s.thermal or {})}.get(key)) for s in self.scored]
            won = Counter(s.sizes for s, verdict in judged if verdict == "reproduced")
            asked = Counter(s.sizes for s, verdict in judged if verdict)
            share = sum(won.values()) / max(sum(asked.values()), 1)
            if 0.0 < share < 1.0:
                where = "; ".join(f"{sizes} {won[sizes] / asked[sizes]:.0%}" for sizes in asked if won[sizes])
                table.add_row(key, f"{share:.0%}", where)
        return table

    def claim_rows(self) -> list[dict[str, Any]]:
        """Return one row a reading with every verdict."""
        keys = list(dict.fromkeys(key for s in self.scored for key in (*s.geometry, *(s.thermal or {}))))
        rows = []
        for s in self.scored:
            row: dict[str, Any] = {"sizes": str(s.sizes), "tilt": s.tilt, "normals": s.normals}
            row |= {"statistic": s.statistic, "coldest_degC": s.coldest_degC, "section_4": s.score[0]}
            verdicts = {**s.geometry, **(s.thermal or {})}
            rows.append(row | {"section_5": s.score[1]} | {key: verdicts.get(key, "out of reach") for key in keys})
        return rows

    def record(self) -> dict[str, Any]:
        """Return all rows, ready for JSON."""
        return {"seed": self.seed, "readings": self.claim_rows()}

    def tables(self) -> Mapping[str, str]:
        """Nothing beside the claims."""
        return {}
