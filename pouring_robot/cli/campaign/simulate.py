"""``pouring-robot campaign simulate``: measure a virtual robot."""

import math
from pathlib import Path
from typing import Annotated, Any

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.exceptions import BadInputError

Frame = tuple[float, float, float, float, float, float]


def _seen(name: str, what: str) -> Any:
    return options.opt(name, f"{what}: mm, rotation vector in degrees.", metavar="X Y Z RX RY RZ")


def simulate(
    *,
    out: Annotated[Path, options.writes("--out", "Table to write, .csv or .parquet; YAML beside.")],
    plan: Annotated[
        Path | None, options.reads("--plan", "Poses as 'path' reads them, and any condition columns.")
    ] = None,
    random: Annotated[int | None, options.opt("--random", "N poses all over the workspace.", metavar="N")] = None,
    seed: Annotated[int, options.opt("--seed", "Seed of everything random.", min=0)] = 0,
    which: bundles.Which,
    under: bundles.Under,
    noise_mm: Annotated[float, options.opt("--noise-mm", "Noise of a coordinate.")] = 0.05,
    noise_mrad: Annotated[float, options.opt("--noise-mrad", "Noise of a rotation component.")] = 0.05,
    position_only: Annotated[bool, options.opt("--position-only", "Measure no rotations.")] = False,
    outliers: Annotated[int, options.opt("--outliers", "Rows with a gross error.", metavar="N", min=0)] = 0,
    outlier_mm: Annotated[float, options.opt("--outlier-mm", "Size of a gross error.")] = 5.0,
    lost: Annotated[float, options.opt("--lost", "Share of measured cells left empty.", metavar="SHARE")] = 0.0,
    tracker_frame: Annotated[Frame | None, _seen("--tracker-frame", "Fixed platform seen from the tracker")] = None,
    target_frame: Annotated[Frame | None, _seen("--target-frame", "Target seen from the moving platform")] = None,
    truth: Annotated[
        Path | None, options.writes("--truth", "Write what was hidden (frames, outliers) as JSON.")
    ] = None,
) -> None:
    """Measure a robot as built without having it: a campaign with noise, outliers and unknown frames."""
    from pouring_robot.campaign.plan import random_plan, read_plan
    from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
    from pouring_robot.io.files import write_together

    if (plan is None) == (random is None):
        raise BadInputError("give the poses by --plan FILE or by --random N, one of the two")
    options.refuse_present([out, out.with_suffix(".yaml"), *([truth] if truth else [])])
    present = which.built(under=True)
    poses = read_plan(plan, present) if plan is not None else random_plan(present, random or 0, seed)
    standing = under.of(present, poses.given(present.model.definition))
    robots = None if standing is None else standing.robots(poses.drives)
    settings = MeasurementOptions(
        sigma_position_m=noise_mm * 1e-3,
        sigma_rotation_rad=None if position_only else noise_mrad * 1e-3,
        outliers=outliers,
        outlier_m=outlier_mm * 1e-3,
        lost=lost,
        pose_tracker_to_fixed_platform=_frame(tracker_frame),
        pose_platform_to_target=_frame(target_frame),
        seed=seed,
    )
    with progress.stage_bars() as show:
        measured = simulate_campaign(present, poses, settings, path=out, robots=robots, progress=show)
    files = measured.campaign.contents(out)
    if truth:
        files[truth] = measured.truth_text(which.model).encode()
    write_together(files)
    options.print_written(files)


def _frame(figures: Frame | None) -> Any:
    import numpy as np
    import pinocchio as pin

    if figures is None:
        return None
    if not all(math.isfinite(value) for value in figures):
        raise BadInputError("a frame has six finite figures: x y z in mm and a rotation vector in degrees")
    return pin.SE3(pin.exp3(np.radians(figures[3:])), np.array(figures[:3]) * 1e-3)
