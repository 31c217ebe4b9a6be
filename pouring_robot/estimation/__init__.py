"""What calibration and diagnosis share.

The measurement model, outer frames, noise, residuals, priors, splits, the solver.
"""
