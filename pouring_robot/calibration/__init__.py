"""Measured data in, calibrated robot out: choice of parameters, fit, judgement on rows nobody has looked at, report."""
