"""The paper's joint regression of thermal errors, as scikit-learn estimators for any table of errors."""
