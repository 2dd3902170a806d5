"""What people and programs read: results derived from records, tables, advice."""
