"""Names of the pouring robot's parts and of groups of its errors, as in the URDF, in files and on the command line."""

DEFAULT_LAYOUT = "paper"
"""The layout in the dimensions file that is used unless one is named."""
CHAINS = (1, 2, 3, 4)
LEGS = tuple(f"leg{i}" for i in CHAINS)
CHAIN_JOINTS = tuple(tuple(f"{leg}_s{k}" for k in range(1, 6)) for leg in LEGS)
"""S1 to S5 of each chain: both rotations of the upper U joint, stroke, both rotations of the lower U joint."""
STROKES = tuple(joints[2] for joints in CHAIN_JOINTS)
INNER_JOINTS = frozenset(name for joints in CHAIN_JOINTS for name in joints[1:])
"""Joints inside a leg and its U joints, whose distances are machined within one part."""
SEATS = tuple(f"{leg}_seat_mount" for leg in LEGS)
"""The fixed joints that place the lower U-joint centres on the moving platform."""

DRIVE_JOINTS = ("leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5")
"""The driven joints, in the order of the controller."""
DRIVE_SYMBOLS = ("l1", "l2", "l3", "theta46")
DRIVE_WORDS = ("leg 1", "leg 2", "leg 3", "the tilt drive")
DRIVE_COLUMNS = ("q1", "q2", "q3", "q4")
"""Names of the drives in a campaign: the first three are lengths, the last is an angle."""

GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "drives": ("zero offsets of the drives", ("drive.*",)),
    "fixed_centres": ("places of the upper U joints on the fixed platform", ("*_s1.t?",)),
    "moving_centres": ("places of the lower U joints on the moving platform", ("*_seat_mount.t?",)),
    "fixed_axes": ("axes of the upper U joints", ("*_s1.r?", "*_s2.r?")),
    "moving_axes": ("axes of the lower U joints", ("*_s4.r?", "*_s5.r?", "*_seat_mount.r?")),
    "leg_axes": ("directions of the legs in their rods", ("*_s3.r?",)),
    "leg_offsets": ("distances inside the legs and U joints", ("*_s2.t?", "*_s3.t?", "*_s4.t?", "*_s5.t?")),
    "dh_fixed_platform": ("fixed-platform installation, DH table", ("theta_e?_0",)),
    "dh_upper_joints": ("upper U joints, DH table", ("*_e?_01", "*_e?_12", "*_e?_1", "d_e?_2")),
    "dh_rods": ("fixed and moving rods, DH table", ("*_e?_23", "*_e?_34", "d_e?_3", "theta_e?_4")),
    "dh_lower_joints": ("lower U joints, DH table", ("*_e?_45", "*_e?_56", "d_e?_5", "d_e?_6")),
    "dh_moving_platform": ("moving-platform installation, DH table", ("*_e?_6o", "*_e?_o")),
}
"""Parameters that one physical cause changes together, by group: meaning on the machine, and name patterns."""
SETS: dict[str, tuple[str, ...]] = {
    "geometry": ("drives", "fixed_centres", "moving_centres", "fixed_axes", "moving_axes"),
    "centres": ("drives", "fixed_centres", "moving_centres"),
    "axes": ("fixed_axes", "moving_axes"),
    "all": ("drives", "fixed_centres", "moving_centres", "fixed_axes", "moving_axes", "leg_axes", "leg_offsets"),
    "dh": ("drives", "dh_fixed_platform", "dh_upper_joints", "dh_rods", "dh_lower_joints", "dh_moving_platform"),
}
"""Named sets of groups. ``centres`` are the errors that close exactly."""
