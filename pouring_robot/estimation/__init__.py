"""What calibration and diagnosis share: measurement model, frames, noise, residuals, priors, splits, the solver."""
