"""Geometric errors: what machining and assembly do to the chains, and what that does to the ladle."""
