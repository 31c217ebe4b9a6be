"""Which effect the model lacks: the gap, where it is, the causes that explain it, the model amended with them.

``found = pouring_robot.diagnose(campaign)`` searches; ``found.verdict``, ``.headline``, ``.effects``, ``.where``,
``.suggestion`` and ``.amended`` are its results, which ``found.save(folder)`` writes. The search itself, which
knows no robot, is in :mod:`pouring_robot.inference`; causes are in :mod:`pouring_robot.effects`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
