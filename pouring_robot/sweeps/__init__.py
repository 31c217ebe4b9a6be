"""Tolerance studies: one-at-a-time sensitivities, Monte Carlo, Sobol indices, and the loosest tolerances.

``sweep("sweep.yaml", "results")`` computes chunk by chunk, goes on after a kill with ``resume=True``, and returns what
was found: ``.headline``, ``.ranking``, ``.to_dataset().displacement``, ``.save()``. A sweep file to start from:
examples/sweep.yaml. ``SweepPlan.load("sweep.yaml")`` checks everything and computes nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
