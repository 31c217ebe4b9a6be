"""The pouring robot: dimensions, xacro, closed-form kinematics, thermal properties, DH table.

Nothing outside this folder, :mod:`pouring_robot.thermal` and ``robot_description`` may name a leg.
"""
