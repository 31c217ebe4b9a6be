"""Closure of a mechanism's loops: the energy of their residuals, and the solver that finds its minimum.

The effects of weight, displaced placements and redundant drives on that energy are here, too.
"""
