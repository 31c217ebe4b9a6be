"""The two frames nobody knows, tracker and target: what is seen through them, their fit, where it starts, sessions."""
