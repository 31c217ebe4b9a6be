"""What the paper's section 4.4 says of directions and distributions (Fig. 4 and 5), and whether our robot agrees.

Distributions are those of an error's largest component, over all poses. They count as uniform when the middle 90 % of
the values keep within 0.1 of a uniform distribution function (0 is perfect; a single peak gives up to 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.robot.pouring.names import CHAINS
from scripts.paper.claims import Claim, judge, listed
from scripts.paper.geometry.study import ANGLE_ERROR_RAD, AXES, NAMED_SENSITIVE, PILE_M, ErrorSamples, GeometryStudy

_UNIFORM_GAP = 0.1
_BIN_M = 0.005 * MM  # width of the bins in which the fullest is looked for; 1.3175 mm is a centre
_BAND = 0.02  # values within this share of 1.3175 mm count as piled up there


def main_x(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge the main direction of four errors."""
    return _main_direction("main_x", errors, ("α12", "α23", "α34", "θ1"), "X")


def main_y(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge the main direction of α01."""
    return _main_direction("main_y", errors, ("α01",), "Y")


def _main_direction(key: str, errors: ErrorSamples, labels: Sequence[str], axis: str) -> Claim:
    found = {label: errors.main_axis(label) for label in labels}
    means = {label: np.abs(errors.moves(label)).mean(axis=0) / MM for label in labels}
    text = "; ".join(f"{k} {found[k]} ({'/'.join(f'{v:.2f}' for v in means[k])})" for k in labels)
    return Claim(
        key,
        "4.4, Fig. 5",
        f"the main direction of {listed(labels)} is {axis}",
        f"{text} mm in X/Y/Z",
        judge(set(found.values()) == {axis}),
        "main direction: the coordinate with the largest mean absolute error",
        used=True,
        figures={"main": found, "mean_mm": {label: mean.tolist() for label, mean in means.items()}},
    )


def concentrated(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether the large errors lie in X and Z."""
    large = errors.reaching(MM)
    share = large.mean_m.sum(axis=0) / max(float(large.mean_m.sum()), 1e-300)
    over = (large.peak_m > MM).sum(axis=0)
    first = "".join(sorted(AXES[k] for k in np.argsort(share)[1:]))
    return Claim(
        "concentrated",
        "4.3, Fig. 4",
        "the errors over 1 mm are concentrated in X and Z",
        f"X/Y/Z carry {'/'.join(f'{s:.0%}' for s in share)} of them; {'/'.join(map(str, over))} errors pass 1 mm there",
        judge(first == "XZ" and bool(large.parameters)),
        "agrees if X and Z carry the two largest shares of the mean absolute errors; they are "
        f"{first[0]} and {first[1]}. Fig. 4 is lost; section 4.4 itself gives α01 the main direction Y",
        figures={"share": share.tolist(), "over_1mm": over.tolist()},
    )


def alike(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether α01 and θ1 spread alike."""
    one, other = (np.sort(np.abs(errors.along(label))) for label in ("α01", "θ1"))
    grid = np.concatenate([one, other])
    gap = np.abs(np.searchsorted(one, grid, "right") - np.searchsorted(other, grid, "right")).max() / len(one)
    return Claim(
        "alike",
        "4.4, Fig. 5",
        "the distributions of α01 and θ1 are basically the same",
        f"{_span(one)} and {_span(other)}; distribution functions differ by {gap:.3f} at most",
        judge(gap < 0.05),
        "of the absolute main components; agrees below 0.05. Both are 4 mrad times the height of o under O",
        used=True,
        figures={"range_mm": [_range_mm(one), _range_mm(other)], "gap": float(gap)},
    )


def uniform(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether five errors are spread evenly, each with one sign."""
    labels = ("α23", "α34", "θ1", "α01", "α12")
    gaps = {label: _uniform_gap(errors.along(label)) for label in labels}
    signs = {label: abs(float(np.sign(errors.along(label)).mean())) for label in labels}
    peaked = [label for label in labels if gaps[label] > _UNIFORM_GAP]
    mixed = [label for label in labels if signs[label] < 1.0]
    return Claim(
        "uniform",
        "4.4, Fig. 5",
        "α23 α34 θ1 α01 α12 are spread uniformly, each in one direction throughout the workspace",
        f"not uniform: {listed(peaked)}; both signs: {listed(mixed)}; gaps "
        + " ".join(f"{label} {gap:.2f}" for label, gap in gaps.items()),
        judge(not peaked and not mixed),
        "uniform if the middle 90 % of the main component keep within 0.1 of an even distribution",
        figures={"gaps": gaps, "one_sign": signs},
    )


def narrow(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether α12 covers a much smaller range than the other four."""
    spans = {label: _middle(errors.along(label)) for label in ("α12", "α23", "α34", "θ1", "α01")}
    own = spans.pop("α12")
    wider = [label for label, span in spans.items() if own <= 0.5 * span]
    return Claim(
        "narrow",
        "4.4, Fig. 5",
        "the range of α12 is much smaller than that of α23 α34 θ1 α01",
        f"{own / MM:.2f} mm against " + ", ".join(f"{label} {span / MM:.2f}" for label, span in spans.items()),
        judge(len(wider) == len(spans)),
        f"middle 90 % of the main component; at most half of: {listed(wider)}",
        used=True,
        figures={"alpha12_mm": own / MM, "others_mm": {label: span / MM for label, span in spans.items()}},
    )


def pile_alpha56(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether α56 piles up at 1.3175 mm."""
    claim = _pile("pile_alpha56", study, errors, "α56", "α56 piles up at ±1.3175 mm, very concentrated")
    return replace(claim, used=True)


def pile_theta1(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether θ1 does, as printed."""
    return _pile("pile_theta1", study, errors, "θ1", "θ1 piles up at ±1.3175 mm (as printed)")


def pile_theta4(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether θ4 does: the reading in which the paper's names agree with each other."""
    claim = _pile("pile_theta4", study, errors, "θ4", "the same, read as θ4 (cf. “αe1,4” in 4.3)")
    return replace(claim, used=True)


def _pile(key: str, study: GeometryStudy, errors: ErrorSamples, label: str, says: str) -> Claim:
    values = np.abs(errors.along(label))
    fullest, share, factor = _peak(values)
    half_width = float(np.abs(study.layout.moving_centres_m[0][1]))
    outside = "" if values.min() <= PILE_M <= values.max() else "1.3175 mm is outside its range. "
    return Claim(
        key,
        "4.4, Fig. 5",
        says,
        f"main component {errors.main_axis(label)}, {_span(values)}; fullest 5 µm bin at {fullest / MM:.4f} mm; "
        f"{share:.0%} of poses within 2 % of 1.3175, {factor:.1f} times an even share",
        judge(abs(fullest - PILE_M) < 0.01 * PILE_M and factor > 2.0),
        f"{outside}Agrees if the fullest bin is within 1 % of 1.3175 and the band holds twice an even share. "
        f"4 mrad × half-width {half_width / MM:.1f} mm = {half_width * ANGLE_ERROR_RAD / MM:.3f} mm; "
        "the sign follows the axis's direction",
        figures={"range_mm": _range_mm(values), "fullest_mm": fullest / MM, "share": share, "times_even": factor},
    )


def near_upper(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge where the box plots of α56 and θ4 sit in their range, against the others."""
    places = {label: _median_place(errors.along(label)) for label in (*NAMED_SENSITIVE, "θ4")}
    high = [label for label, place in places.items() if place > 0.75]
    return Claim(
        "near_upper",
        "4.3, Fig. 4",
        "most are spread evenly; α56 and “αe1,4” lie near the upper end",
        "median at " + ", ".join(f"{label} {place:.0%}" for label, place in places.items()) + " of the range",
        judge(set(high) == {"α56", "θ4"}),
        "of the absolute main component; near the upper end: above 75 %. αe1,4 read as θ4: an α has two indices",
        figures={"median_place": places},
    )


def other_chains(study: GeometryStudy, errors: ErrorSamples) -> Claim:
    """Judge whether the analysis of chain 1 holds for the others."""
    every = study.open_branch if errors.kind == "open branch" else study.closed_chain
    first = {label: errors.main_axis(label) for label in errors.reaching(MM).labels}
    differences = []
    for chain in CHAINS[1:]:
        of_chain = every.of_chain(chain)
        found = {label: of_chain.main_axis(label) for label in of_chain.reaching(MM).labels}
        differences += [
            f"{label} in chain {chain}" for label in sorted({*first, *found}) if first.get(label) != found.get(label)
        ]
    return Claim(
        "other_chains",
        "4.3",
        "chains 2–4 are completely the same as chain 1",
        f"other class or main direction: {', '.join(differences) or 'none'}",
        judge(not differences),
        "agrees if the same errors pass 1 mm with the same main directions",
        figures={"differences": differences},
    )


def _peak(values: FloatArray) -> tuple[float, float, float]:
    """Return the centre of the fullest bin, the share of values near 1.3175 mm, and that over an even share."""
    edges = np.arange(0.0, values.max() + 2.0 * _BIN_M, _BIN_M)
    place = int(np.histogram(values, edges)[0].argmax())
    share = float(np.mean(np.abs(values - PILE_M) < _BAND * PILE_M))
    even = 2.0 * _BAND * PILE_M / max(float(np.ptp(values)), 2.0 * _BAND * PILE_M)
    return float(edges[place] + 0.5 * _BIN_M), share, share / even


def _uniform_gap(values: FloatArray) -> float:
    """Return how far the middle 90 % of values are from evenly spread: largest gap of distribution functions."""
    low, high = np.quantile(values, [0.05, 0.95])
    middle = np.sort(values[(values >= low) & (values <= high)])
    if high - low < 1e-12:
        return 1.0
    return float(np.abs((middle - low) / (high - low) - np.linspace(0.0, 1.0, len(middle))).max())


def _middle(values: FloatArray) -> float:
    low, high = np.quantile(values, [0.05, 0.95])
    return float(high - low)


def _median_place(values: FloatArray) -> float:
    """Return where the median of the absolute values lies between their least (0) and largest (1)."""
    absolute = np.abs(values)
    span = float(np.ptp(absolute))
    return float((np.median(absolute) - absolute.min()) / span) if span > 0.0 else 0.5


def _range_mm(values: FloatArray) -> list[float]:
    return [float(values.min()) / MM, float(values.max()) / MM]


def _span(values: FloatArray) -> str:
    low, high = _range_mm(values)
    return f"{low:.2f}–{high:.2f} mm"


SHAPE_CLAIMS = (
    concentrated,
    near_upper,
    main_x,
    main_y,
    alike,
    uniform,
    narrow,
    pile_alpha56,
    pile_theta1,
    pile_theta4,
    other_chains,
)
