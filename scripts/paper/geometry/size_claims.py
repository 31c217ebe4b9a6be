"""What the paper's section 4.3 says of the size of errors, and whether our robot agrees.

The figures are those of one chain's errors, in its open branch or in the closed chain.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.sensitivity.samples import short_label
from scripts.paper.claims import Claim, judge, listed
from scripts.paper.geometry.study import (
    ANGLE_ERROR_RAD,
    ATTITUDE_BOUNDARY_RAD,
    NAMED_SENSITIVE,
    POSITION_BOUNDARY_M,
    ErrorSamples,
    OpenStudy,
)
from scripts.paper.tables import load_tables


def only_angles(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge whether all errors that reach 1 mm are angles."""
    large = errors.reaching(MM)
    lengths = large.of_unit("m").labels
    lever = float(errors.of_unit("rad").distance_m.max() / ANGLE_ERROR_RAD)
    return Claim(
        "only_angles",
        "4.3, Fig. 4",
        "position errors of 1 mm and more all come from angle errors",
        f"over 1 mm: {len(large.parameters) - len(lengths)} angles; lengths: {listed(lengths)}",
        judge(bool(large.parameters) and not lengths),
        "errors exceed 1 mm in at least one coordinate at some pose, and none of them is a length",
        f"4 mrad act on levers of up to {lever:.2f} m",
        figures={"over_1mm": large.labels, "lengths_over_1mm": lengths, "lever_m": lever},
    )


def seven_in_chain(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge the number of errors over 1 mm and their names."""
    labels = errors.reaching(MM).labels
    by_distance = [
        f"{short_label(p)} ({d.max() / MM:.2f} mm, {np.mean(d > MM):.0%} of poses)"
        for p, d in zip(errors.parameters, errors.distance_m, strict=True)
        if d.max() > MM and short_label(p) not in labels
    ]
    others = [name for name in labels if name not in NAMED_SENSITIVE]
    missing = [name for name in NAMED_SENSITIVE if name not in labels]
    return Claim(
        "seven_in_chain",
        "4.3, 4.4",
        "seven parameters of chain 1 cause them: α01 α12 α23 α34 α56 θ1 and one more (“αe1,4”, “θe1,1”)",
        f"{len(labels)}: {listed(labels)}",
        judge(len(labels) == 7 and not missing),
        "seven errors exceed 1 mm in at least one coordinate at some pose, among them the six that the paper names",
        f"besides the six: {listed(others)}; missing: {listed(missing)}; by distance also: {listed(by_distance)}",
        reading="counted by coordinate; the seventh is misprinted, so it may be any error",
        used=True,
        figures={"over_1mm": labels, "by_distance_also": by_distance, "missing": missing, "beside": others},
    )


def attitude_size(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge the size of the attitude error."""
    angles, lengths = errors.of_unit("rad").angle_rad.max(axis=1), errors.of_unit("m").angle_rad.max(axis=1)
    small = [name for name, a in zip(errors.of_unit("rad").labels, angles, strict=True) if not 1e-3 <= a < 1e-2]
    return Claim(
        "attitude_size",
        "4.3, 4.4",
        "attitude errors are of the order 1e-3 rad and all come from angle errors",
        f"largest {angles.min() / MRAD:.2f} to {angles.max() / MRAD:.2f} mrad from an angle, "
        f"{lengths.max() / MRAD:.3f} mrad from a length",
        judge(not small and lengths.max() < 1e-4),
        "every angle error reaches 1 to 10 mrad and no length error 0.1 mrad",
        f"in an open branch a rotation of a joint is an equal rotation of o; outside: {listed(small)}",
        figures={"angle_mrad": (angles / MRAD).tolist(), "length_mrad": (lengths / MRAD).tolist(), "outside": small},
    )


def length_size(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge the size of what length errors do."""
    lengths = errors.of_unit("m")
    top = lengths.distance_m.max(axis=1)
    outside = [name for name, value in zip(lengths.labels, top, strict=True) if not 0.1 * MM <= value < MM]
    return Claim(
        "length_size",
        "4.3, Table 3",
        "length errors of 0.2 mm stay at 1e-1 mm",
        f"they move o by {top.min() / MM:.3f} to {top.max() / MM:.3f} mm at most",
        judge(not outside),
        "the largest distance of every length error is 0.1 to 1 mm",
        f"in an open branch a displaced joint displaces o by the same length; outside: {listed(outside)}",
        reading="implied: errors of 1e0 mm “are all caused by” angles, and 1e-1 is the class below; Table 3 is lost",
        figures={"largest_mm": dict(zip(lengths.labels, (top / MM).tolist(), strict=True)), "outside": outside},
    )


def negligible_position(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge which errors do nothing to the position."""
    top = errors.distance_m.max(axis=1)
    none = [name for name, value in zip(errors.labels, top, strict=True) if value < POSITION_BOUNDARY_M]
    ends = _tops(errors, ("α6o", "θo"), top)
    return Claim(
        "negligible_position",
        "4.3, Table 3",
        "the errors α6o and θo can be ignored: in position",
        f"α6o {ends[0] / MM:.1e} mm, θo {ends[1] / MM:.1e} mm; below 1e-3 mm: {listed(none)}",
        judge(set(none) == {"α6o", "θo"}),
        "only these two stay below the paper's 1e-3 mm",
        f"true only for o: 4 mrad move the lip, {study.lip_lever_m:.2f} m from o, by {study.lip_lever_m * 4:.1f} mm",
        reading="the position of o",
        figures={"below": none, "largest_mm": (ends / MM).tolist(), "lip_lever_m": study.lip_lever_m},
    )


def negligible_attitude(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge whether the two are negligible in attitude as well."""
    ends = _tops(errors, ("α6o", "θo"), errors.angle_rad.max(axis=1))
    return Claim(
        "negligible_attitude",
        "4.3, Table 3",
        "the errors α6o and θo can be ignored: in attitude",
        f"α6o {ends[0] / MRAD:.2f} mrad, θo {ends[1] / MRAD:.2f} mrad",
        judge(ends.max() < ATTITUDE_BOUNDARY_RAD),
        "both stay below the paper's boundary of 1e-5 rad",
        "an angle error rotates o wherever it is in the chain",
        figures={"largest_mrad": (ends / MRAD).tolist()},
    )


def _tops(errors: ErrorSamples, labels: Iterable[str], values: FloatArray) -> FloatArray:
    return np.array([values[errors.labels.index(label)] for label in labels])


def eight_omitted(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge the number left out of chain 1 in the end."""
    chain = errors.parameters[0].chain
    dropped = sum(p.chain == chain and p.drops_out for p in study.table.parameters)
    weak = int((errors.distance_m.max(axis=1) < POSITION_BOUNDARY_M).sum())
    return Claim(
        "eight_omitted",
        "4.3, Table 2 and 3",
        "with α6o and θo eight parameters are left out of chain 1",
        f"{dropped} + {weak} = {dropped + weak}",
        judge(dropped + weak == 8),
        "parameters that drop out by section 4.2 and errors below 1e-3 mm in position are eight together",
        "rules (a) and (b) remove seven per chain and α6o, θo make nine; eight would need six in Table 2",
        figures={"dropped": dropped, "negligible": weak},
    )


def table_3(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Judge what the text says of Table 3."""
    position = errors.distance_m.max(axis=1) >= POSITION_BOUNDARY_M
    attitude = errors.angle_rad.max(axis=1) >= ATTITUDE_BOUNDARY_RAD
    total = len(errors.parameters)
    return Claim(
        "table_3",
        "4.3, Table 3",
        "most parameters influence the position much and the attitude little",
        f"of {total}: {position.sum()} reach 1e-3 mm, {attitude.sum()} reach 1e-5 rad",
        judge(2 * position.sum() > total and 2 * attitude.sum() < total),
        "more than half reach 1e-3 mm and fewer than half reach 1e-5 rad",
        "in an open branch lengths cause no rotation, angles always do",
        reading="“most” is more than half; boundaries are the paper's",
        figures={"position": int(position.sum()), "attitude": int(attitude.sum()), "of": total},
    )


def table_3_cells(study: OpenStudy, errors: ErrorSamples) -> Claim:
    """Count our own classification; the paper's cells are lost."""
    decades = np.floor(np.log10(np.maximum(errors.distance_m.max(axis=1) / MM, 1e-9)) + 1e-9).astype(int)
    classes = {f"1e{d} mm": int((decades == d).sum()) for d in sorted(set(decades.tolist()), reverse=True) if d > -9}
    below = int((decades == -9).sum())
    text = ", ".join(f"{count} of order {name}" for name, count in classes.items())
    table = load_tables().table_3
    found = dict(zip(errors.labels, decades.tolist(), strict=True))
    off = [n for n, (order, _) in (table or {}).items() if n not in found or found[n] != round(np.log10(order))]
    return Claim(
        "table_3_cells",
        "4.3, Table 3",
        "every parameter of chain 1 has its class",
        f"by largest distance: {text}, {below} without effect" + (f"; disagree: {listed(off)}" if table else ""),
        judge(not off) if table else "cannot be checked",
        "every error of Table 3 has our order of magnitude in position",
        "the cells are not in our text; ours are in parameters.csv, a reader's can go into paper_tables.yaml",
        figures={"classes": classes, "without_effect": below},
    )


SIZE_CLAIMS = (
    only_angles,
    seven_in_chain,
    attitude_size,
    length_size,
    negligible_position,
    negligible_attitude,
    eight_omitted,
    table_3,
    table_3_cells,
)
