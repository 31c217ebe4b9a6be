"""Files written whole or not at all, YAML into typed models, tables, quantities and their units, what users give.

Beside them what runs long goes by: progress, interrupts, seeds, threads, work in a process of its own, the cache on
disk; and the two figures that stand where nobody says any, of temperatures and of noise. Nothing here knows a robot.
Every fault becomes one line that names file, line and key or column.
"""
