"""Which explanations data ask for, and what may be said: evidence, hypotheses, search, decision.

Arrays only: nothing here knows a robot, a campaign or an effect.
"""
