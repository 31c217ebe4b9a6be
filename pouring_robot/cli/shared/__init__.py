"""What subcommands have in common: options, tables, progress, and what is said of a location."""
