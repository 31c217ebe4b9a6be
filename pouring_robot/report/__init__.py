"""One look for everything that is read: parts of HTML pages, Matplotlib figures, colours.

Nothing here knows what is reported; each room writes its own report with these parts.
"""
