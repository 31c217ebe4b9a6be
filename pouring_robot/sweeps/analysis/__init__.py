"""What a finished sweep says: summary, Sobol indices, ranking, the loosest tolerances, report and picture."""
