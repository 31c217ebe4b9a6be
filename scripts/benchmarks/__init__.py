"""Speed of the package, and blind trials of its diagnosis."""
