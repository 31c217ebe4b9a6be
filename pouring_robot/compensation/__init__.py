"""What to command so that the actual ladle, with errors and heat, comes to the wanted pose."""
