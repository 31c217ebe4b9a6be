"""What to measure: the most informative poses and conditions for wanted parameters (D-optimal and other indices)."""
