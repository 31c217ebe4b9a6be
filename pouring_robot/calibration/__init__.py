"""Measured data in, calibrated robot out: choice of parameters, fit, test on held-out rows, report."""
