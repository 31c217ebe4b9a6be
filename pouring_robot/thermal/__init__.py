"""Heat: from the melt to the ladle, and the regression that predicts its error from the melt temperature."""
