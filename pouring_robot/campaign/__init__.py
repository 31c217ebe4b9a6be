"""Measured data: one static pose a row, what was commanded, under which conditions, what was seen."""
