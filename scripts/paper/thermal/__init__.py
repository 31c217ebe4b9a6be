"""The paper's section 5: heat, and the regression of its error."""
