"""What several subcommands share: options, tables, drawings, heat."""
