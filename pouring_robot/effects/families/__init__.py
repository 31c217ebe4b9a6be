"""Families of effects, by what is at fault: drives, joints, what heat and weight do to them, the surroundings."""
