"""What the paper's sections 4.1 and 4.2 say of the parameters, and whether our robot agrees.

A claim is a function of a study. It computes its figures first, and from them its verdict by a rule that its text
states, so that another layout may get another verdict. Sizes of errors: :mod:`~scripts.paper.geometry.size_claims`;
directions and distributions: :mod:`~scripts.paper.geometry.shape_claims`.
"""

from __future__ import annotations

import numpy as np

from pouring_robot.io.units import MM
from pouring_robot.robot.pouring.names import CHAINS
from scripts.paper.claims import Claim, judge, listed
from scripts.paper.geometry.study import POSITION_BOUNDARY_M, GeometryStudy
from scripts.paper.tables import load_tables

_MEANT = {
    "fixed-platform installation": ("s1",),
    "upper U joint": ("s1",),
    "fixed rod": ("s2",),
    "moving rod": ("s3",),
    "lower U joint": ("s4", "s5"),
    "moving-platform installation": ("seat_mount",),
}
"""Joints of a chain whose placements a part fixes, by the words of Table 1."""


def eight_transforms(study: GeometryStudy) -> Claim:
    """Judge the structure of the table and that its product is the robot."""
    counts = [len({p.transform for p in study.table.parameters if p.chain == i}) for i in study.table.chains]
    total, missed = len(study.table.parameters), study.reproduction_m
    return Claim(
        "eight_transforms",
        "4.1, formula 1",
        "O→0→1→2→3→4→5→6→o: eight transforms per chain, each of a, α, d, θ",
        f"{listed(map(str, counts))} transforms, {total} parameters; their product gives o to {missed / MM:.0e} mm",
        judge(set(counts) == {8} and total == len(CHAINS) * 32 and missed < 1e-12),
        "each chain has eight of four numbers, and their product gives every nominal pose to 1e-9 mm",
        "the table is computed from the URDF, nothing is entered by hand",
        figures={"transforms": counts, "parameters": total, "missed_mm": missed / MM},
    )


def meanings(study: GeometryStudy) -> Claim:
    """Compare which joint each transform displaces with the meanings of Table 1, row by row."""
    table = load_tables().table_1
    displaced = {p.transform: p.joint.removeprefix("leg1_") for p in study.table.parameters if p.chain == 1}
    off = [transform for transform, joint in displaced.items() if table and joint not in _MEANT[table[transform]]]
    text = "; ".join(f"{transform} {joint}" for transform, joint in displaced.items())
    return Claim(
        "meanings",
        "4.1, Table 1",
        "; ".join(f"{transform}: {meaning}" for transform, meaning in (table or {}).items())
        or "each error has a physical meaning",
        f"joint whose placement each transform displaces: {text}; rows that disagree: {listed(off)}",
        judge(not off) if table else "cannot be checked",
        "every row names a part that holds the joint that our transform displaces",
        "errors of the 4-UPU chain are errors of its joint placements, so each belongs to one part",
        figures={"joints": displaced, "disagree": off},
    )


def four_groups(study: GeometryStudy) -> Claim:
    """Judge whether the DH errors describe every displacement of the six joint placements."""
    alone, both = study.closure.ranks.table, study.closure.ranks.placements
    return Claim(
        "four_groups",
        "4.1, formula 5",
        "all geometric errors can be mapped to Δa, Δα, Δd, Δθ",
        f"rank of the closed chain's G: {alone} for the 128 errors, {both} with all 144 joint displacements added",
        judge(alone == both),
        "displacements of all 24 placements in all six directions do not increase the rank",
        "four numbers per transform describe any chain whose axes do not stay parallel",
        figures={"rank_table": alone, "rank_with_placements": both},
    )


def drop_outs(study: GeometryStudy) -> Claim:
    """Judge the parameters that section 4.2 takes out, and that nothing is lost by it."""
    expected = {f"{name}_e{i}_{to}" for i in CHAINS for name, to in _convention()}
    for i in CHAINS:
        expected |= {f"{name}_e{i}_{to}" for name, to in _passive(i)}
    found = {p.name for p in study.table.parameters if p.drops_out}
    ranks, moved = study.closure.ranks, study.closure.passive_effect_m
    return Claim(
        "drop_outs",
        "4.2 (a), (b)",
        "aO0 αO0 d0 drop out of every chain; θ2 θ3 θ5 θ6 of chains 1–3, θ2 θ3 d4 θ5 of chain 4",
        f"{len(found)} drop out, {len(found ^ expected)} of them not as in the paper; an error of a passive joint "
        f"moves o by {moved / MM:.0e} mm; rank of G {ranks.table} with, {ranks.kept} without them",
        judge(found == expected and ranks.kept == ranks.table and moved < POSITION_BOUNDARY_M),
        "the same parameters drop out, an error of a passive joint has no effect and the rank of G is the same",
        "it follows from which joints are driven; what a passive joint compensates is no error",
        figures={
            "dropped": sorted(found),
            "rank_with": ranks.table,
            "rank_without": ranks.kept,
            "moved_mm": moved / MM,
        },
    )


def _convention() -> tuple[tuple[str, str], ...]:
    return ("a", "O0"), ("alpha", "O0"), ("d", "0")


def _passive(chain: int) -> tuple[tuple[str, str], ...]:
    last = ("d", "4") if chain == CHAINS[-1] else ("theta", "6")
    return ("theta", "2"), ("theta", "3"), ("theta", "5"), last


def eight_or_nine(study: GeometryStudy) -> Claim:
    """Judge how many parameters a chain drop out."""
    counts = [sum(p.chain == i and p.drops_out for p in study.table.parameters) for i in study.table.chains]
    left = f"{128 - 4 * 9}–{128 - 4 * 8}"
    return Claim(
        "eight_or_nine",
        "4.2, Table 2",
        "8–9 parameters per chain can be ignored",
        f"{listed(map(str, counts))} by the rules of section 4.2",
        judge(set(counts) <= {8, 9}),
        "8 or 9 drop out of every chain",
        f"rules (a) and (b) name 3 + 4 per chain; 8–9 would leave {left}, not the 100 the paper gives in 4.3",
        figures={"dropped_per_chain": counts},
    )


def hundred_left(study: GeometryStudy) -> Claim:
    """Judge how many remain."""
    left = len(study.table.selection())
    return Claim(
        "hundred_left",
        "4.3",
        "the whole mechanism has 100 geometric error parameters",
        f"{left} remain of {len(study.table.parameters)}",
        judge(left == 100),
        "100 remain",
        "4 chains of 32, minus the 7 that section 4.2 removes from each",
        reading="d_o is one of them: its nominal value is 0, and formula 2 has no term for it; without it 96 remain",
        figures={"remaining": left},
    )


def superposition(study: GeometryStudy) -> Claim:
    """Judge whether errors of this size add up, for all of chain 1 at once."""
    total = study.open_branch.of_chain(1).translation_m.sum(axis=0)
    share = np.linalg.norm(study.together_m - total, axis=1) / np.linalg.norm(total, axis=1)
    worst = float(share.max())
    return Claim(
        "superposition",
        "4.1, formula 4",
        "errors are small, so they superpose linearly",
        f"the effect of all 25 errors of chain 1 at once differs from the sum of their effects by {worst:.2%} at most",
        judge(worst < 0.02),
        "they differ by less than 2 % at any pose",
        "the difference is of second order: products of angles of 4 mrad",
        reading="one open branch, all 25 errors positive",
        figures={"largest_share": worst},
    )


PARAMETER_CLAIMS = (
    eight_transforms,
    meanings,
    four_groups,
    drop_outs,
    eight_or_nine,
    hundred_left,
    superposition,
)
