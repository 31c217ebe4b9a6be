"""Temperatures of the robot.

Elements and what they see of the melt, a network of conduction and radiation, steady or over time.
"""
