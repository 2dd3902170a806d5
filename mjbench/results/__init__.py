"""Run files, and what a result comes to, whatever shows it: tables, pages, documents."""
