"""Reduced bodies with joints and springs between them, and the claim of the whole.

May import: basics, model, reduced_model.
"""
