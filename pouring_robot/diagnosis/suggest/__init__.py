"""What to measure next, to distinguish the explanations that a diagnosis leaves."""
