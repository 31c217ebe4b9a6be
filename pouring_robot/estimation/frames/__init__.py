"""The two unknown frames, tracker and target: what is measured through them, their fit, its starts, sessions."""
