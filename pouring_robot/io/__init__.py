"""Files: written whole or not at all, YAML into typed models, tables, progress of long work.

Nothing here knows a robot. Every fault becomes one line that names file, line and key or column.
"""
