"""What the paper's sections 4.1 and 4.2 say of the parameters, and whether our robot agrees.

A claim is a function of a study. It computes its figures first, and its verdict from them by a rule that its text
gives, so that another layout may get another verdict. Sizes of errors: :mod:`~scripts.paper.geometry.size_claims`;
directions and distributions: :mod:`~scripts.paper.geometry.shape_claims`.
"""

from __future__ import annotations

import numpy as np

from pouring_robot.mechanism.poses import MM
from pouring_robot.robot.pouring.names import CHAINS
from scripts.paper.claims import Claim, judge, listed
from scripts.paper.geometry.study import POSITION_BOUNDARY_M, GeometryStudy


def eight_transforms(study: GeometryStudy) -> Claim:
    """Judge the structure of the table and that its product is the robot."""
    counts = [len({p.transform for p in study.table.parameters if p.chain == i}) for i in study.table.chains]
    total, missed = len(study.table.parameters), study.reproduction_m
    return Claim(
        "eight_transforms",
        "4.1, formula 1",
        "O→0→1→2→3→4→5→6→o: eight transforms a chain, each of a, α, d, θ",
        f"{listed(map(str, counts))} transforms, {total} parameters; their product misses o by {missed / MM:.0e} mm",
        judge(set(counts) == {8} and total == len(CHAINS) * 32 and missed < 1e-12),
        "the table is read off the URDF; its product must give every nominal pose to 1e-9 mm",
        figures={"transforms": counts, "parameters": total, "missed_mm": missed / MM},
    )


def meanings(study: GeometryStudy) -> Claim:
    """Say which joint each transform displaces; the paper's own table of meanings is lost."""
    joints: dict[str, list[str]] = {}
    for p in study.table.parameters:
        if p.chain == 1:
            of_joint = joints.setdefault(p.joint.removeprefix("leg1_"), [])
            if p.transform not in of_joint:
                of_joint.append(p.transform)
    text = "; ".join(f"{'+'.join(transforms)}: {joint}" for joint, transforms in joints.items())
    return Claim(
        "meanings",
        "4.1, Table 1",
        "each error has a physical meaning",
        f"each displaces one joint's placement ({text})",
        "cannot be checked",
        "the cells of Table 1 are not in the text; our reading: O0 platform, 01 12 upper U joint, 23 34 rods, "
        "45 56 lower U joint, 6o moving platform",
        figures={"joints": joints},
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
        "agrees if adding displacements in all six directions of all 24 placements raises no rank",
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
        f"{len(found)} drop out, {len(found ^ expected)} of them others than the paper's; an error of a passive joint "
        f"moves o by {moved / MM:.0e} mm; rank of G {ranks.table} with, {ranks.kept} without them",
        judge(found == expected and ranks.kept == ranks.table and moved < POSITION_BOUNDARY_M),
        "found by which joints are driven; nothing the ladle can show is lost if the rank stays",
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
        "8–9 parameters a chain can be ignored",
        f"{listed(map(str, counts))} by the rules of section 4.2",
        judge(set(counts) <= {8, 9}),
        f"rules (a) and (b) name 3 + 4 a chain; 8–9 would leave {left}, not the paper's 100. Table 2's cells are lost",
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
        "128 less the drop-outs of section 4.2",
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
        f"all 25 errors of chain 1 at once differ from their sum by {worst:.2%} at most",
        judge(worst < 0.02),
        "agrees below 2 %; one open branch, all errors positive",
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
