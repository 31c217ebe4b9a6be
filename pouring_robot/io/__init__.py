"""Files written whole or not at all, YAML into typed models, tables, quantities and their units, arguments of users.

Also what long computations need: progress, interrupts, seeds, threads, work in other processes, the cache on disk; and
the defaults of temperatures and of noise. Nothing here knows a robot. Every fault becomes one line that names file,
line and key or column.
"""
