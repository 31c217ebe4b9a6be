"""Analysis of a finished sweep: summary, Sobol indices, ranking, the loosest tolerances, report and picture."""
