"""Reduced bodies with joints and springs between them, and what is claimed of the whole.

May import: basics, model.
"""
