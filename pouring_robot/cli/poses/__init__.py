"""Commands about poses, cold or warm: where the robot is, also along a path, how it looks, what to command instead."""
