"""Temperatures: elements and their view of the melt, a network of conduction and radiation, steady or transient."""
