"""Where model and measurement disagree: by component, region and condition."""
