"""A second examiner: blind campaigns from a compliant machine that shares no code and no formulation with the package.

The machine is a compliant multibody system in maximal coordinates (`machine`), its campaigns have histories
(`conditions`, `coincidences`), its faults are from machine-tool literature (`faults`) or in nobody's library
(`strangers`); `rig` combines machine, faults and instrument, `judge` measures a fault in units of noise and says which
effects a campaign cannot distinguish, `cases` draws and writes.
Run it with `python -m tests.examiner --out DIR --cases N --seed S`.
"""
