"""Commands about poses, cold or warm: where the robot is, along a path too, how it looks, what to command instead."""
