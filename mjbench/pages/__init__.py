"""Renderers: what results come to (`report.content`) on a terminal and in files.

`terminal`, `html`, `markdown` and `fragment` show sections. `reports` chooses those of several
runs, `exports` writes for other tools.
"""
