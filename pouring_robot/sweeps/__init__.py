"""Tolerance studies: one-at-a-time sensitivities, Monte Carlo, Sobol indices, and the loosest tolerances.

``sweep("sweep.yaml", "results")`` computes chunk by chunk, continues after a kill with ``resume=True``, and returns the
results: ``.headline``, ``.ranking``, ``.to_dataset().displacement``, ``.save()``. A sweep file to start from is
examples/sweep.yaml. ``SweepPlan.load("sweep.yaml")`` checks everything and computes nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
