"""Names of the pouring robot's parts, as the URDF, the files and the command line have them."""

from __future__ import annotations

CHAINS = (1, 2, 3, 4)
LEGS = tuple(f"leg{i}" for i in CHAINS)
CHAIN_JOINTS = tuple(tuple(f"{leg}_s{k}" for k in range(1, 6)) for leg in LEGS)
"""S1 to S5 of each chain: turn and turn of the upper U joint, stroke, turn and turn of the lower U joint."""
INNER_JOINTS = frozenset(name for joints in CHAIN_JOINTS for name in joints[1:])
"""Joints inside a leg and its U joints, whose distances are machined in one part."""
SEATS = tuple(f"{leg}_seat_mount" for leg in LEGS)
"""The fixed joints that place the lower U-joint centres on the moving platform."""

DRIVE_JOINTS = ("leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5")
"""The driven joints, in the order of the controller."""
DRIVE_SYMBOLS = ("l1", "l2", "l3", "theta46")
DRIVE_WORDS = ("leg 1", "leg 2", "leg 3", "the tilt drive")
DRIVE_COLUMNS = ("q1", "q2", "q3", "q4")
"""What a campaign calls the drives: the first three are lengths, the last is an angle."""
