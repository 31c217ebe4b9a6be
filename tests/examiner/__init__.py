"""A second examiner: blind campaigns from a compliant machine that shares no code and no formulation with the package.

The machine is a compliant multibody in maximal coordinates (`machine`), its campaigns have histories (`conditions`,
`coincidences`), its faults are drawn from machine-tool literature (`faults`) or stand in nobody's library
(`strangers`); `rig` puts machine, faults and instrument together, `judge` sizes a fault in units of noise and says
which effects a campaign cannot tell apart, `cases` draws and writes.
Run it with `python -m tests.examiner --out DIR --cases N --seed S`.
"""
