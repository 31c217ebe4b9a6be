"""Common parts of subcommands: options, tables, progress, and the output on a location."""
