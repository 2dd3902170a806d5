"""Reports of run files: what `mjbench report` writes, as HTML and as Markdown.

Records become content (`content`), which knows nothing of its form; `html` and `markdown` give it
one. Charts are Vega-Lite specifications (`charts`), drawn as SVG.
"""
