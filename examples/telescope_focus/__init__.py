"""The diagnosis core on a telescope: what moves the best focus of the Mayall 4 m telescope."""
