"""Which effect the model lacks: the gap, where it is, the causes that explain it, the model amended with them."""
