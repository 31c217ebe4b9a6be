"""The paper's section 4: geometric errors."""
