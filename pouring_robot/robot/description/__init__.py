"""What a robot of the drawing is: its robot file, URDF, drives, names and causes of error; and where it closes."""
