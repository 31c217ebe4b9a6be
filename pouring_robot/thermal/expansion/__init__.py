"""From temperatures to poses: legs and platforms grow, the warm robot is closed, temperatures and pose agree."""
