"""What to measure next, so that the explanations a diagnosis leaves can be told apart."""
