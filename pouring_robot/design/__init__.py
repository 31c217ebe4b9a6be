"""What to measure: poses and conditions that tell most about the parameters wanted (D-optimal and other indices)."""
