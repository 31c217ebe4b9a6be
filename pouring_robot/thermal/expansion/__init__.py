"""From temperatures to poses: legs and platforms expand, and the warm robot is closed until both are consistent."""
