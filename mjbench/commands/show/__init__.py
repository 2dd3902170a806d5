"""Stored results as tables, documents and reports."""
