"""The pouring robot: dimensions, xacro, closed-form kinematics, stiffness, thermal properties, names, causes.

Nothing outside this folder, :mod:`pouring_robot.thermal` and ``robot_description`` may name a leg. The modules for its
user, ``pouring_robot.py`` and ``pouring_under_weight.py``, are in the folder above, because they depend on the model
file (``model.py``), which depends on the definition here.
"""
