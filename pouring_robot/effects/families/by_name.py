"""Which families of effects there are: a new one is a class in the fitting file beside this one, and its name here."""

from pouring_robot.effects.base import Family
from pouring_robot.effects.families.drives import Coupling, LostMotion, Periodic, Ratio, Scale, Zero
from pouring_robot.effects.families.growth import DriveGrowth, LinkGrowth, LinksGrowth
from pouring_robot.effects.families.joints import Centres, Placement, Tilts
from pouring_robot.effects.families.loads import Bearing, Deflection, Spring, Stretch
from pouring_robot.effects.families.surroundings import BaseDrift, MetrologyScale, SessionOffset

FAMILIES: dict[str, type[Family]] = {
    "zero": Zero,
    "scale": Scale,
    "ratio": Ratio,
    "coupling": Coupling,
    "periodic": Periodic,
    "lost_motion": LostMotion,
    "centres": Centres,
    "tilts": Tilts,
    "placement": Placement,
    "drive_growth": DriveGrowth,
    "link_growth": LinkGrowth,
    "links_growth": LinksGrowth,
    "stretch": Stretch,
    "spring": Spring,
    "bearing": Bearing,
    "deflection": Deflection,
    "base_drift": BaseDrift,
    "metrology_scale": MetrologyScale,
    "session_offset": SessionOffset,
}
"""By the name that a robot's causes have for them."""
