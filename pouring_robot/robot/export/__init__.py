"""The closed robot as files for other programs: URDF and SRDF, MJCF, SDF, and tables of joint values."""
