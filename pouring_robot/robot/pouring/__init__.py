"""The pouring robot: dimensions, xacro, closed-form kinematics, stiffness, thermal properties, names, causes.

Nothing outside this folder, :mod:`pouring_robot.thermal` and ``robot_description`` may name a leg. What its user asks,
``pouring_robot.py`` and ``pouring_under_weight.py``, stands beside it: it rests on the model file (``model.py``), and
that on the definition here.
"""
