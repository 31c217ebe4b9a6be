"""The paper, claim by claim: what it says, what we compute, whether they agree and why."""
