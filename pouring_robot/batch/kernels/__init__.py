"""Compiled kernels of the batch engine. Nothing outside :mod:`pouring_robot.batch` calls them.

They take plain arrays only (:mod:`pouring_robot.batch.structure`) and allocate nothing.
"""
