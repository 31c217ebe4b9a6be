"""Which explanations the data require, and what may be said: evidence, hypotheses, search, decision.

Arrays only: nothing here knows a robot, a campaign or an effect. ``Problem.build`` takes residuals, the columns of
nuisance parameters and those of every explanation; ``search`` finds which are at work, ``judge`` decides what may be
said.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
