"""How the loops of a mechanism are closed: the least energy of what is left open, and the solver that finds it.

What weight, displaced placements and redundant drives have to do with that energy is here too.
"""
