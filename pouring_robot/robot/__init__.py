"""What a robot is to its user: the model file, the robot of the drawing beside the robot as built, where its ladle is.

``load_robot(path).locate(pose)`` answers the package's question. What is special about this one robot stands in
:mod:`pouring_robot.robot.pouring`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
