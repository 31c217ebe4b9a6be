"""What a robot is to its user: its model file, the nominal robot and the robot as built, and where its ladle is.

``load_robot(path).locate(pose)`` answers the package's question. What is specific to the pouring robot is in
:mod:`pouring_robot.robot.pouring`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
