"""What subcommands have in common: options, tables, progress, heat, and what is said of a location."""
