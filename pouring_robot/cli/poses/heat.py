"""The heat of the robot according to the command line, and what is printed of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pouring_robot.cli.shared.options import say, with_melt
from pouring_robot.cli.shared.tables import print_table
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.units import MM
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location_figures import difference_figures
from pouring_robot.robot.pouring.platform_pose import PlatformPose

if TYPE_CHECKING:
    from pouring_robot.mechanism.arrays import FloatArray
    from pouring_robot.robot.location import LadleLocation, Location
    from pouring_robot.robot.robot import Command, Robot
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, PoseShares, WarmState
    from pouring_robot.thermal.regression.thermal_model import ThermalModel


@dataclass(frozen=True, eq=False)
class ThermalLaw:
    """A thermal-model file at one melt temperature, and the same heat for the full closure, for comparison."""

    model: ThermalModel
    melt_degC: float
    heat: HeatSection

    def moves_m(self, pose: PlatformPose) -> FloatArray:
        """Return the platform's displacement by heat at a commanded pose, shape (3,), in m."""
        return self.model.displacement_m(self.melt_degC, _inputs(pose))

    def words(self, *poses: PlatformPose) -> str:
        """Return its source, the conditions it ignores, and values of poses outside the range of its fit, in words."""
        said = [f"thermal model of {self.model.source}", f"melt {self.melt_degC:g} degC"]
        if self.heat.after_min is not None or self.heat.ambient_degC is not None:
            said.append("ignoring time and surroundings")
        beyond = dict.fromkeys(words for pose in poses for words in self.model.beyond(self.melt_degC, _inputs(pose)))
        return ", ".join(said) + (f", BEYOND the fitted range: {', '.join(beyond)}" if beyond else "")

    def sum_mm(self, robot: Robot, full: LadleLocation) -> dict[str, list[float]]:
        """Return theory, geometry, heat, their sum (the paper's Fig. 13) and the full closure, in mm."""
        pose, end = full.commanded, full.loops.end_frame
        parts: dict[str, FloatArray] = {
            "theory": np.array(pose.position_m),
            "geometry": np.asarray(robot.location_of(pose).difference(end).translation_m),
            "heat": self.moves_m(pose),
        }
        parts["sum"] = sum(parts.values(), start=np.zeros(3))
        parts["full_closure"] = parts["theory"] + full.difference(end).translation_m
        parts["sum_misses_by"] = parts["sum"] - parts["full_closure"]
        return {name: (np.asarray(shift) / MM).tolist() for name, shift in parts.items()}

    def print_sum(self, robot: Robot, full: LadleLocation) -> None:
        """Print the sum next to the full closure."""
        rows = [
            (name.replace("_", " "), *(f"{value:+z.3f}" for value in shift))
            for name, shift in self.sum_mm(robot, full).items()
        ]
        # A title of the table would be wrapped at the table's width.
        say(f"the paper's sum for the platform, mm; {self.words(full.commanded)}", style="italic")
        print_table(("", "x", "y", "z"), rows)


def _inputs(pose: PlatformPose) -> dict[str, float]:
    from pouring_robot.thermal.regression.thermal_model import POSE_INPUTS

    return dict(zip(POSE_INPUTS, pose.values, strict=True))


def thermal_law(path: Path | None, robot: Robot, heat: HeatSection | None, *, cold: bool) -> ThermalLaw | None:
    """Return the thermal model of a file at the temperature of the melt; None without a file."""
    if path is None:
        return None
    if cold:
        raise BadInputError("--cold leaves heat out, but --thermal-model adds it; give one of the two")
    from pouring_robot.thermal.regression.thermal_model import POSE_INPUTS, ThermalModel

    model = ThermalModel.load(path)
    if foreign := [name for name in model.inputs if name not in POSE_INPUTS]:
        raise BadInputError(
            f"{path} depends on {', '.join(foreign)}, but a pose gives {', '.join(POSE_INPUTS)}; "
            "repeat the regression with these in --poses, or without --poses"
        )
    with_melt(robot)
    same = heat or HeatSection()
    return ThermalLaw(model, same.temperatures_degC[0], same)


@dataclass(frozen=True, eq=False)
class Warmth:
    """The result for one command, cold or warm."""

    robot: Robot
    location: Location
    warm: tuple[HeatedRobot, WarmState] | None = None  # None: cold, without heat and temperatures
    shares: dict[str, PoseShares] = field(default_factory=dict)  # errors by geometry and heat, by frame

    @classmethod
    def of(cls, robot: Robot, heated: HeatedRobot | None, command: Command, *, shares: bool = False) -> Warmth:
        """Compute it, and the shares of geometry and heat if ``shares`` is set."""
        from pouring_robot.cli.shared.locations import in_its_unit

        with in_its_unit(robot, command):
            if heated is None:
                return cls(robot, robot.location_of(command))
            if not isinstance(command, PlatformPose):
                raise BadInputError("a warm robot needs a pose: give --at-mm and --tilt-deg, or --cold")
            state = heated.locate(command)
        loops = state.location.loops
        found = heated.shares(state, (loops.end_frame or "", loops.working_frame)) if shares else {}
        return cls(state.robot, state.location, (heated, state), found)

    def figures(self) -> dict[str, Any]:
        """Return heat and shares, ready for JSON; nothing for a cold robot."""
        if self.warm is None:
            return {}
        found: dict[str, Any] = {"heat": heat_figures(*self.warm)}
        if self.shares:
            found["shares"] = {frame: _share_figures(one) for frame, one in self.shares.items()}
        return found

    def print(self) -> None:
        """Print errors by geometry and heat alone and together, their difference from the sum, and the heat."""
        if self.warm is None:
            return
        rows, (_, state) = [], self.warm
        for frame, one in self.shares.items():
            for k, (name, part) in enumerate(_share_figures(one).items()):
                shift, turn = ([f"{v:+z.3f}" for v in part[key]] for key in ("translation_mm", "rotation_mrad"))
                cells = [*shift, f"{part['distance_mm']:.3f}", *turn]
                rows.append(("" if k else frame, name.replace("_", " "), *cells))
        head = ("frame", "", "x", "y", "z", "|xyz|", "rx", "ry", "rz")
        print_table(head, rows, (0, 1), title="shares of the error: mm, mrad")
        lip = list(self.shares.values())[-1]
        missing = lip.remainder.distance_m
        say(
            f"the shares need not add up: geometry + heat differs from the lip's full error by {missing / MM:.4f} mm, "
            f"{missing / max(lip.together.distance_m, 1e-15):.2%} of it"
        )
        say(heat_line(*self.warm))
        say(
            f"temperatures computed at the ladle's place {state.turns} times; the last change moved it by "
            f"{state.unsettled_m / MM:.1e} mm{unsettled_words(state.unsettled_m)}"
        )


def _share_figures(shares: PoseShares) -> dict[str, Any]:
    """Return the three shares and their difference from the sum, in mm and mrad, ready for JSON."""
    figures: dict[str, Any] = {
        name: difference_figures(getattr(shares, name)) for name in ("geometry", "heat", "together")
    }
    remainder = difference_figures(shares.remainder)
    del remainder["angle_mrad"]  # a difference of rotation vectors is not a rotation
    return figures | {"not_the_sum_by": remainder}


def heated_of(robot: Robot, heat: HeatSection | None) -> HeatedRobot | None:
    """Return the robot with its heat, or None for a cold one."""
    if heat is None:
        return None
    # The thermal network is slow to import; only a warm robot needs it.
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot

    return HeatedRobot(with_melt(robot), heat)


def twice_lines(robot: Robot, heat: HeatSection | None) -> tuple[str, ...]:
    """Return a line that warns if both the melt and effects of the model apply heat; otherwise nothing."""
    if heat is None or not robot.model.conditional:
        return ()
    from pouring_robot.effects.available import all_effects
    from pouring_robot.effects.conditions import RISE

    known = all_effects(robot.model.definition)
    names = [name for name in robot.model.conditional if any(need.endswith(RISE) for need in known[name].needs)]
    if not names:
        return ()
    return (f"heat counts twice: by the melt, and by {', '.join(names)} of the model; keep one",)


def heat_line(heated: HeatedRobot, state: WarmState) -> str:
    """Return the heat of the robot on one line."""
    return f"heat: {heated.summary(state.field.summary if state.field else '')}"


def alone_line(heat: HeatSection) -> str:
    """Return on one line how long each pose of a list is held."""
    held = "until steady" if heat.after_min is None else f"{heat.after_min:g} min"
    return (
        f"each pose is computed on its own, from cold and held {held}, without the heat of earlier poses; "
        "for poses one after the other, see pouring-robot thermal --history"
    )


def unsettled_words(unsettled_m: float) -> str:
    """Return a warning where temperatures and pose did not converge to 1e-6 mm, or nothing."""
    return "" if unsettled_m <= 1e-6 * MM else ": NOT settled"


def heat_figures(heated: HeatedRobot, state: WarmState) -> dict[str, Any]:
    """Return the heat of the robot, ready for JSON."""
    if heated.heat is None or state.field is None:
        return {"on": False}
    melt, ambient = heated.temperatures_degC
    return {
        "on": True,
        "melt_degC": melt,
        "ambient_degC": ambient,
        "after_min": heated.heat.after_min,
        "computed_degC": state.field.mean_degC,
        "measured_degC": heated.heat.measured_degC,
        **asdict(state.robot.expansion),
        "temperatures_taken": state.turns,
        "unsettled_mm": state.unsettled_m / MM,
    }
