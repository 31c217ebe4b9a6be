"""One look for all output: parts of HTML pages, Matplotlib figures, colours.

Nothing here depends on what is reported; each room writes its own report with these parts.
"""
