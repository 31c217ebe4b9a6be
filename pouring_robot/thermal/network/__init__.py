"""Temperatures: elements and what they see of the melt, a network of conduction and radiation, steady or over time."""
