"""Diagnosis: where model and measurement disagree, which effect is missing, and how sure that is."""
