"""Recordings against the truth: errors, scores, tables, pictures, the report, checks."""
