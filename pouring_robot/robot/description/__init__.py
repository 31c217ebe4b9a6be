"""Description of the nominal robot: robot file, URDF, drives, names and causes of error; and its closure."""
